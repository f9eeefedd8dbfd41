"""All effects, in the order in which they are applied."""

from __future__ import annotations

from radar.simulation.effects.base import Effect
from radar.simulation.effects.channels import ChannelErrors
from radar.simulation.effects.clutter import Clutter
from radar.simulation.effects.converter import Quantisation
from radar.simulation.effects.coupling import AntennaCoupling
from radar.simulation.effects.dead import DeadElements
from radar.simulation.effects.dielectric import Dielectric
from radar.simulation.effects.motion import TargetMotion
from radar.simulation.effects.multipath import Multipath
from radar.simulation.effects.noise import ThermalNoise
from radar.simulation.effects.obliquity import Obliquity
from radar.simulation.effects.oscillator import OscillatorNoise
from radar.simulation.effects.pattern import AntennaPattern
from radar.simulation.effects.positions import PositionErrors
from radar.simulation.effects.shadow import ShadowAntennas, ShadowCentre
from radar.simulation.effects.skin import Skin
from radar.support.config import suggest
from radar.support.errors import HandbenchError

EFFECTS: tuple[Effect, ...] = (
    PositionErrors(),
    AntennaPattern(),
    Obliquity(),
    ShadowCentre(),
    ShadowAntennas(),
    Skin(),
    Dielectric(),
    Multipath(),
    TargetMotion(),
    AntennaCoupling(),
    Clutter(),
    ChannelErrors(),
    OscillatorNoise(),
    ThermalNoise(),
    Quantisation(),
    DeadElements(),
)
IDS = tuple(effect.id for effect in EFFECTS)


def check_names(names: tuple[str, ...]) -> None:
    """Refuse names that no effect has, and repeated ones."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
