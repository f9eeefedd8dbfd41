"""Selection of the effects with which a scene is simulated: a list of names, or "auto".

"auto" is every effect that the scene has a cause for. Left out are effects that another one
includes, and, where the target is a lone plate or box, shadows of one part on another and multiple
bounces.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from handbench.radar.simulation.ablation import FINE, Ablation
from handbench.radar.simulation.catalogue import BETWEEN_PARTS, CONTAINED, EFFECTS, Effect
from handbench.radar.simulation.known_effects import Choice, check_names
from handbench.radar.simulation.physics.facets import convex_block
from handbench.radar.simulation.scene import EchoScene
from handbench.support.errors import HandbenchError

Wanted = tuple[str, ...] | Literal["auto"]


def choose(scene: EchoScene, wanted: Wanted, explain: bool = False) -> tuple[Choice, ...]:
    """Choose the effects with which a scene is simulated: one row per effect, on or off, in the
    order of application.

    wanted: "auto", or the names of the effects. explain: also measure the size of each effect, by
    coarse simulations with and without it, and add it to the row. Raises HandbenchError for a
    wanted effect that is unknown or whose cause the scene lacks.
    """
    missing = {effect.id: effect.missing(scene) for effect in EFFECTS}
    there = [effect for effect in EFFECTS if not missing[effect.id]]
    off = {name: f"needs {cause}" for name, cause in missing.items() if cause}
    if wanted == "auto":
        off |= _unneeded(scene, [effect.id for effect in there])
    else:
        _check(wanted, missing)
        off |= {effect.id: "not listed" for effect in there if effect.id not in wanted}
    sizes = _sizes(scene, there) if explain else {}
    reason, rows = "has a cause" if wanted == "auto" else "listed", []
    for effect in EFFECTS:
        why = off.get(effect.id) or "; ".join(filter(None, (reason, effect.way(scene))))
        known = sizes.get(effect.id, {})
        rows.append(Choice(effect=effect.id, on=effect.id not in off, why=why, **known))
    return tuple(rows)


def _check(wanted: tuple[str, ...], missing: dict[str, str]) -> None:
    """Raise HandbenchError for a wanted effect that is unknown or whose cause is missing."""
    check_names(wanted)
    for name in wanted:
        if missing[name]:
            raise HandbenchError(
                f"effects: '{name}' needs {missing[name]}; add this to the scene, or leave "
                "the effect out"
            )


def _unneeded(scene: EchoScene, there: list[str]) -> dict[str, str]:
    """Return those of the effects `there` that are not needed, with the reason."""
    off = {}
    if scene.target and not (scene.room or scene.balls) and convex_block(scene.body):
        off = dict.fromkeys(BETWEEN_PARTS, "the target is convex and has flat sides")
    for name in there:
        including = [other for other in _including(name) if other in there and other not in off]
        if including:
            off[name] = f"contained in {including[0]}"
    return off


def _including(name: str) -> Iterator[str]:
    """Yield the effects that include an effect, directly or through others, as a blurred shadow
    includes a sharp one."""
    while name in CONTAINED:
        yield (name := CONTAINED[name])


def _sizes(scene: EchoScene, there: list[Effect]) -> dict[str, dict[str, float | None]]:
    """Return how much each effect changes depths and echoes, as values of its row, by coarse
    simulations with and without it.

    An effect is left out together with those that include it, since otherwise nothing would change.
    """
    ablation, sizes = Ablation(scene, there, CONTAINED), {}
    for effect in there:
        without = {effect.id, *_including(effect.id)}
        changes, level_db = ablation.change(without), ablation.level_db(without)
        sizes[effect.id] = {
            "depth_mm": changes[FINE].depth_mm,
            "worst_mm": max(change.depth_mm for change in changes.values()),
            "pixels_percent": 100 * max(change.pixels for change in changes.values()),
            "level_db": level_db if np.isfinite(level_db) else None,
        }
    return sizes
