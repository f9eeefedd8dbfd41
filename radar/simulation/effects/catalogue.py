"""All effects, in the order in which they are applied."""

from __future__ import annotations

from radar.simulation.effects import antennas, receiver, surface
from radar.simulation.effects.base import Effect
from radar.simulation.effects.clutter import Clutter
from radar.simulation.effects.dielectric import Dielectric
from radar.simulation.effects.motion import TargetMotion
from radar.simulation.effects.multipath import Multipath
from radar.support.config import suggest
from radar.support.errors import HandbenchError

EFFECTS: tuple[Effect, ...] = (
    antennas.PositionErrors(),
    antennas.AntennaPattern(),
    surface.Obliquity(),
    surface.ShadowCentre(),
    surface.ShadowAntennas(),
    surface.Skin(),
    Dielectric(),
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
IDS = tuple(effect.id for effect in EFFECTS)


def check_names(names: tuple[str, ...]) -> None:
    """Refuse names that no effect has, and repeated ones."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
