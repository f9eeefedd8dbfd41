"""Selection of the effects with which a scene is simulated: a list of names, or "auto".

"auto" leaves out slow effects that a quick estimate shows to be small: together, all effects that
are left out change no method's depth map by more than the tolerance. Effects that cost little time
or have no estimate are on.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from handbench.radar.simulation.ablation import FINE, Ablation, Change
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS, Effect
from handbench.radar.simulation.effects.quick_estimate import echo_s
from handbench.radar.simulation.known_effects import Choice, check_names
from handbench.radar.simulation.scene import EchoScene
from handbench.support.errors import HandbenchError
from handbench.support.parallel import one_blas_thread

LITTLE = 0.02  # an effect that takes a smaller share of the simulation's time is on
SAFETY = 2.0  # the estimates of all effects left out may add up to the tolerance over this
Wanted = tuple[str, ...] | Literal["auto"]


@dataclass
class Selection:
    """Findings about the effects, each a dictionary by effect.

    left_out: why the effect is off; reasons: why it is on; changes: how it changes the depth map of
    each method; levels_db: power of its change to the echoes relative to the echoes (both from
    simulations without the effect); costs_s: estimated CPU seconds.
    """

    left_out: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    changes: dict[str, dict[str, Change]] = field(default_factory=dict)
    levels_db: dict[str, float] = field(default_factory=dict)
    costs_s: dict[str, float] = field(default_factory=dict)


def choose(
    scene: EchoScene, wanted: Wanted, tolerance_mm: float, explain: bool = False
) -> tuple[Choice, ...]:
    """Choose the effects with which a scene is simulated: one row per effect, on or off, in the
    order of application.

    wanted: "auto", or the names of the effects. tolerance_mm: for "auto", the largest change of any
    method's depths by all effects that are left out. explain: also measure the size of each effect,
    by coarse simulations with and without it, and add it to the row. Raises HandbenchError for a
    wanted effect that is unknown or whose cause the scene lacks.
    """
    missing = {effect.id: effect.missing(scene) for effect in EFFECTS}
    if wanted != "auto":
        check_names(wanted)
        for name in wanted:
            if missing[name]:
                raise HandbenchError(
                    f"effects: '{name}' needs {missing[name]}; add this to the scene, or leave "
                    "the effect out"
                )
    there = [effect for effect in EFFECTS if not missing[effect.id]]
    with one_blas_thread():  # or what is near the tolerance would depend on the number of cores
        found = _auto(scene, there, tolerance_mm) if wanted == "auto" else Selection()
    on = {effect.id for effect in there} - set(found.left_out)
    for name in CONTAINED:
        if container := _container(name, on):
            found.left_out[name] = f"contained in {container}"
    if explain:
        _explain(found, scene, there)
    rows = (_choice(effect.id, wanted, missing[effect.id], found) for effect in EFFECTS)
    return tuple(
        row.model_copy(update={"why": f"{row.why}; {way}"})
        if row.on and (way := effect.way(scene))
        else row
        for effect, row in zip(EFFECTS, rows, strict=True)
    )


def _auto(scene: EchoScene, effects: list[Effect], tolerance_mm: float) -> Selection:
    """Choose effects automatically: leave out those that by quick estimates together change no
    method's depths by more than the tolerance. effects: those whose cause the scene has."""
    there, own_s = (
        {effect.id for effect in effects},
        {effect.id: effect.cost_s(scene) for effect in effects},
    )
    # An effect that is included in another one costs nothing extra.
    costs = {
        name: 0.0 if CONTAINED.get(name) in there else seconds for name, seconds in own_s.items()
    }
    found, spent_mm, whole_s = Selection(costs_s=costs), 0.0, echo_s(scene) + sum(costs.values())
    for effect in sorted(effects, key=lambda effect: effect.id in CONTAINED):
        if CONTAINED.get(effect.id) in found.left_out:
            costs[effect.id] = own_s[effect.id]
        if costs[effect.id] < LITTLE * whole_s:
            found.reasons[effect.id] = f"takes {100 * costs[effect.id] / whole_s:.0f} % of the time"
        elif (estimate := effect.estimate(scene)) is None:
            found.reasons[effect.id] = "its size is not known without simulating it"
        else:
            reason = (
                f"about {estimate.worst_mm:.2g} mm, to a factor of {estimate.factor:g}: "
                f"{estimate.why}"
            )
            if (
                max(estimate.factor * estimate.worst_mm, spent_mm + SAFETY * estimate.worst_mm)
                <= tolerance_mm
            ):
                spent_mm += SAFETY * estimate.worst_mm
                found.left_out[effect.id] = reason
            else:
                alone = estimate.factor * estimate.worst_mm <= tolerance_mm
                found.reasons[effect.id] = reason + (
                    "; too much together with what is left out" if alone else ""
                )
    return found


def _container(name: str, on: set[str]) -> str | None:
    """Return the effect among those in `on` that includes the effect `name`, directly or through
    others, as a blurred shadow includes a sharp one; None if none does."""
    container = CONTAINED.get(name)
    return container if container is None or container in on else _container(container, on)


def _explain(found: Selection, scene: EchoScene, effects: list[Effect]) -> None:
    """Add to `found` how much each effect changes depths and echoes, by coarse simulations with and
    without it.

    An effect is left out together with those that include it, since otherwise nothing would change.
    """
    ablation, there = Ablation(scene, effects, CONTAINED), {effect.id for effect in effects}
    found.costs_s = {effect.id: effect.cost_s(scene) for effect in effects}
    for name in there:
        without = {name}
        while container := _container(name, there - without):
            without.add(container)
        found.changes[name], found.levels_db[name] = (
            ablation.change(without),
            ablation.level_db(without),
        )


def _choice(name: str, wanted: Wanted, missing: str, found: Selection) -> Choice:
    if missing:
        return Choice(effect=name, on=False, why=f"needs {missing}")
    if wanted == "auto":
        on, why = (
            name not in found.left_out,
            found.left_out.get(name, found.reasons.get(name, "called for")),
        )
    else:
        on, why = name in wanted, "listed" if name in wanted else "not listed"
    known: dict[str, float | None] = {"cost_s": found.costs_s.get(name)}
    if changes := found.changes.get(name):
        known["depth_mm"] = changes[FINE].depth_mm
        known["worst_mm"] = max(change.depth_mm for change in changes.values())
        known["pixels_percent"] = 100 * max(change.pixels for change in changes.values())
        level_db = found.levels_db.get(name, -np.inf)
        known["level_db"] = level_db if np.isfinite(level_db) else None
    return Choice(effect=name, on=on, why=why, **known)
