"""Selection of the effects with which a scene is simulated: a list of names, or "auto", which is
every effect that the scene has a cause for."""

from typing import Literal

from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.scene import Choice, EchoScene
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

Wanted = tuple[str, ...] | Literal["auto"]


def choose(scene: EchoScene, wanted: Wanted) -> tuple[Choice, ...]:
    """Choose the effects with which a scene is simulated: one row per effect, on or off, in the
    order of application.

    wanted: "auto", or the names of the effects. Raises HandbenchError for a wanted effect that is
    unknown, listed twice, or whose cause the scene lacks.
    """
    rows, names = [], () if wanted == "auto" else check_names(wanted)
    for effect in EFFECTS:
        caused = bool(effect.cause(scene))
        if effect.id in names and not caused:
            raise HandbenchError(
                f"effects: '{effect.id}' needs {effect.needs}; add this to the scene, or leave "
                "the effect out"
            )
        on = caused if wanted == "auto" else effect.id in names
        why = "has a cause" if wanted == "auto" else "listed"
        off = "not listed" if caused else f"needs {effect.needs}"
        rows.append(Choice(effect=effect.id, on=on, why=why if on else off))
    return tuple(rows)


def check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names. Raises HandbenchError for one that is no effect or is listed twice."""
    known = [effect.id for effect in EFFECTS]
    for name in names:
        if name not in known:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, known)}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
    return names
