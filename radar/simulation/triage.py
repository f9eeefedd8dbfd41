"""The choice of `effects = "auto"`: which effects a scene can do without, found for less than they cost.

An effect that takes no time is on, unasked. Of the others a glance tells which are nothing or far too much. The rest is
rehearsed (`radar.simulation.rehearsal`) one by one and then all that is left out together, but only where that takes
less than SHARE of the simulation: what is not worth its estimate is on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from handbench.radar.simulation.effects.base import Effect, Glance, echo_s
from handbench.radar.simulation.rehearsal import Change, Rehearsal
from handbench.radar.simulation.scene import EchoScene

SHARE = 0.04  # of the whole simulation's seconds: what estimating may take
LITTLE = 0.02  # of the same: an effect that takes less is on, unasked
SAFETY = 2.0  # a rehearsal may be wrong by this factor
LOST_MM = 10.0  # a pixel lost or gained counts as much as one that moves so far
REHEARSED = 0.4  # seconds of a rehearsal over those of a simulation, which has more tones and finer facets


@dataclass
class Triage:
    """left_out: the effects that are not needed, and why; reasons: of those that are on; changes: by method, and
    levels_db, of those that were rehearsed; costs_s: the seconds expected."""

    left_out: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    changes: dict[str, dict[str, Change]] = field(default_factory=dict)
    levels_db: dict[str, float] = field(default_factory=dict)
    costs_s: dict[str, float] = field(default_factory=dict)


def worst_mm(changes: dict[str, Change]) -> float:
    """The largest change of a method's map, lost and gained pixels included."""
    return max(max(change.depth_mm, LOST_MM * change.pixels) for change in changes.values())


def triage(scene: EchoScene, effects: Sequence[Effect], contained: dict[str, str], tolerance_mm: float) -> Triage:
    """The effects (of those that the scene has a cause for) that together change no method's map by more than the
    tolerance; contained: effects that another one does, where that is on."""
    there = {effect.id for effect in effects}
    own_s = {effect.id: effect.cost_s(scene) for effect in effects}
    # What another effect does takes no time of its own.
    costs = {name: 0.0 if contained.get(name) in there else seconds for name, seconds in own_s.items()}
    found, spent_mm, doubtful = Triage(costs_s=costs), 0.0, []
    whole_s = echo_s(scene) + sum(costs.values())
    for effect in sorted(effects, key=lambda effect: effect.id in contained):
        if contained.get(effect.id) in found.left_out:
            costs[effect.id] = own_s[effect.id]
        part = costs[effect.id] / whole_s
        if part < LITTLE:
            found.reasons[effect.id] = f"on unasked, since it takes {100 * part:.0f} % of the time"
        elif (glance := scene.kept(("glance", effect.id), partial(effect.glance, scene))) is None:
            doubtful.append(effect)
        elif glance.factor * glance.worst_mm <= tolerance_mm and spent_mm + SAFETY * glance.worst_mm <= tolerance_mm:
            spent_mm += SAFETY * glance.worst_mm
            found.left_out[effect.id] = f"far below {tolerance_mm:g} mm: {_told(glance)}"
        elif glance.worst_mm >= glance.factor * tolerance_mm:
            found.reasons[effect.id] = f"far above {tolerance_mm:g} mm: {_told(glance)}"
        else:
            doubtful.append(effect)
    price_s = REHEARSED * (echo_s(scene) * (2 + len(doubtful)) + sum(costs[effect.id] for effect in doubtful))
    if price_s > SHARE * whole_s:
        why = f"on, since to rehearse what is in doubt would take about {price_s:.1f} of {whole_s:.1f} s"
        found.reasons |= {effect.id: why for effect in doubtful}
    elif doubtful:
        cast = [effect for effect in effects if effect in doubtful or costs[effect.id] < LITTLE * whole_s]
        _rehearse(found, Rehearsal(scene, cast, contained), [effect.id for effect in doubtful], tolerance_mm - spent_mm)
        for name, container in contained.items():
            if name in there and container in found.left_out and name not in found.left_out:
                costs[name], found.reasons[name] = own_s[name], f"in place of {container}"
    return found


def _rehearse(found: Triage, rehearsal: Rehearsal, names: list[str], left_mm: float) -> None:
    """Leave out as many of the effects in doubt as together stay below, beside those that take no time."""
    found.changes = {name: rehearsal.change({name}) for name in names}
    sizes = {name: worst_mm(change) for name, change in found.changes.items()}
    out: list[str] = []
    for name in sorted(sizes, key=sizes.__getitem__):
        together_mm = worst_mm(rehearsal.change({*out, name})) if out else sizes[name]
        if SAFETY * together_mm > left_mm:
            break
        out.append(name)
        found.left_out[name] = f"rehearsed: with all that is smaller it changes maps by {together_mm:.3f} mm"
    rest = [name for name in names if name not in out]
    found.reasons |= {name: f"rehearsed: changes maps by {sizes[name]:.3f} mm" for name in rest}


def _told(glance: Glance) -> str:
    return f"about {glance.worst_mm:.2g} mm at a glance ({glance.why})"
