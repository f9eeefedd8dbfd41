"""All effects, in the order in which they are applied."""

from __future__ import annotations

from radar.config import suggest
from radar.effects.channels import ChannelErrors
from radar.effects.clutter import Clutter
from radar.effects.converter import Quantisation
from radar.effects.coupling import AntennaCoupling
from radar.effects.dead import DeadElements
from radar.effects.dielectric import Dielectric
from radar.effects.effect import Effect
from radar.effects.motion import TargetMotion
from radar.effects.multipath import Multipath
from radar.effects.noise import ThermalNoise
from radar.effects.obliquity import Obliquity
from radar.effects.oscillator import OscillatorNoise
from radar.effects.pattern import AntennaPattern
from radar.effects.positions import PositionErrors
from radar.effects.shadow import ShadowAntennas, ShadowCentre
from radar.effects.skin import Skin
from radar.errors import HandbenchError

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
