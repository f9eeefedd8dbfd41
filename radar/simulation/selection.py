"""All effects, and the rows that say which of them a scene is simulated with: those that are listed, or those that
`radar.simulation.triage` leaves on."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from handbench.radar.simulation.effects import antennas, receiver, scattering
from handbench.radar.simulation.effects.base import Effect
from handbench.radar.simulation.effects.dielectric import Dielectric
from handbench.radar.simulation.effects.further import Clutter, Multipath
from handbench.radar.simulation.effects.motion import TargetMotion
from handbench.radar.simulation.effects.roughness import SurfaceRoughness
from handbench.radar.simulation.known_effects import Choice, check_names
from handbench.radar.simulation.rehearsal import FINE, Rehearsal
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.triage import Triage, triage
from handbench.support.errors import HandbenchError

# In the order in which they are applied, which is that of known_effects.toml.
EFFECTS: tuple[Effect, ...] = (
    antennas.PositionErrors(),
    antennas.AntennaPattern(),
    scattering.Obliquity(),
    scattering.ShadowCentre(),
    scattering.ShadowAntennas(),
    scattering.ShadowDiffraction(),
    scattering.Skin(),
    Dielectric(),
    SurfaceRoughness(),
    Multipath(),
    TargetMotion(),
    antennas.AntennaCoupling(),
    Clutter(),
    antennas.ChannelErrors(),
    receiver.OscillatorNoise(),
    receiver.ThermalNoise(),
    receiver.Quantisation(),
    antennas.DeadElements(),
)
Wanted = tuple[str, ...] | Literal["auto"]
# The one is done by the other, where that is on.
CONTAINED = {"shadow_centre": "shadow_antennas", "shadow_antennas": "shadow_diffraction"}


def choose(scene: EchoScene, wanted: Wanted, tolerance_mm: float, explain: bool = False) -> tuple[Choice, ...]:
    """The row of every effect in the order of the catalogue. explain: give estimates for a list too."""
    missing = {effect.id: effect.missing(scene) for effect in EFFECTS}
    if wanted != "auto":
        check_names(wanted)
        for name in wanted:
            if missing[name]:
                raise HandbenchError(f"effects: '{name}' needs {missing[name]}; add it or leave the effect out")
    there = [effect for effect in EFFECTS if not missing[effect.id]]
    found = triage(scene, there, CONTAINED, tolerance_mm) if wanted == "auto" else Triage()
    on = {effect.id for effect in there} - set(found.left_out)
    for name in CONTAINED:
        if container := _container(name, on):
            found.left_out[name] = f"contained in {container}"
    if explain:
        _explain(found, scene, there)
    return tuple(_choice(effect.id, wanted, missing[effect.id], found) for effect in EFFECTS)


def _container(name: str, on: set[str]) -> str | None:
    """The effect among those that are on which does what `name` does, too."""
    container = CONTAINED.get(name)
    return container if container is None or container in on else _container(container, on)


def _explain(found: Triage, scene: EchoScene, effects: Sequence[Effect]) -> None:
    """Add what leaving out each effect does, beside all others; of a contained one, together with what contains it."""
    rehearsal, there = Rehearsal(scene, effects, CONTAINED), {effect.id for effect in effects}
    found.costs_s = {effect.id: effect.cost_s(scene) for effect in effects}
    for name in there:
        without = {name}
        while container := _container(name, there - without):
            without.add(container)
        found.changes[name], found.levels_db[name] = rehearsal.change(without), rehearsal.level_db(without)


def _choice(name: str, wanted: Wanted, missing: str, found: Triage) -> Choice:
    if missing:
        return Choice(effect=name, on=False, why=f"needs {missing}")
    if wanted == "auto":
        on, why = name not in found.left_out, found.left_out.get(name, found.reasons.get(name, "called for"))
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
