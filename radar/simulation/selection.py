"""All effects, and the selection of those that a scene calls for.

`auto` leaves out the smallest effects as long as the sum of their estimates, doubled since estimates may be wrong by
a factor of two (docs/effects.md), stays within the tolerance: estimates are means of magnitudes, whose sum bounds the
mean of the whole change. Every effect above the tolerance is on.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from radar.simulation.effects import antennas, receiver, scattering
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.effects.dielectric import Dielectric
from radar.simulation.effects.further import Clutter, Multipath
from radar.simulation.effects.motion import TargetMotion
from radar.simulation.scene import EchoScene
from radar.support.config import Config, suggest
from radar.support.errors import HandbenchError

# In the order in which they are applied.
EFFECTS: tuple[Effect, ...] = (
    antennas.PositionErrors(),
    antennas.AntennaPattern(),
    scattering.Obliquity(),
    scattering.ShadowCentre(),
    scattering.ShadowAntennas(),
    scattering.ShadowDiffraction(),
    scattering.Skin(),
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

Wanted = tuple[str, ...] | Literal["auto"]
SAFETY = 2.0
# The one is done by the other, where that is on.
CONTAINED = {"shadow_centre": "shadow_antennas", "shadow_antennas": "shadow_diffraction"}

# How strongly the target reflects hardly moves its depths, but it matters beside echoes that do not share that
# strength: clutter has its own, and two bounces have its square.
STRENGTHS, ABSOLUTE = ("skin", "dielectric"), ("clutter", "multipath")


class Choice(Config):
    """One effect's row: whether it is on and why; depth_mm, pixels_percent (lost and gained) and level_db, its estimate
    (None: not asked for or estimated, or the scene has no cause); cost_s, what it was expected to take; seconds, what
    it took (None: off or not simulated)."""

    effect: str
    on: bool
    why: str
    depth_mm: float | None = None
    pixels_percent: float | None = None
    level_db: float | None = None
    cost_s: float | None = None
    seconds: float | None = None


def choose(scene: EchoScene, wanted: Wanted, tolerance_mm: float, explain: bool = False) -> tuple[Choice, ...]:
    """The row of every effect in the order of the catalogue. explain: give estimates for a list too."""
    missing = {effect.id: effect.missing(scene) for effect in EFFECTS}
    if wanted != "auto":
        check_names(wanted)
        for name in wanted:
            if missing[name]:
                raise HandbenchError(f"effects: '{name}' needs {missing[name]}; add it or leave the effect out")
    asked = wanted == "auto" or explain
    estimates = {effect.id: effect.estimate(scene) for effect in EFFECTS if asked and not missing[effect.id]}
    reasons = _budget(estimates, tolerance_mm) if wanted == "auto" else {}
    return tuple(_choice(effect.id, wanted, missing[effect.id], estimates, reasons) for effect in EFFECTS)


def check_names(names: tuple[str, ...]) -> None:
    """Refuse names that no effect has, and repeated ones."""
    for name in names:
        if name not in IDS:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, list(IDS))}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")


def _budget(estimates: dict[str, Estimate], tolerance_mm: float) -> dict[str, str]:
    """Effects that may be left out, and why."""
    left_out: dict[str, str] = {}
    spent_mm = 0.0
    for name, estimate in sorted(estimates.items(), key=lambda item: item[1].depth_mm):
        spent_mm += SAFETY * estimate.depth_mm
        if spent_mm > tolerance_mm:
            break
        left_out[name] = f"with all that is smaller, twice its size is {spent_mm:.3f} of {tolerance_mm:g} mm"
    if any(name in estimates and name not in left_out for name in ABSOLUTE):
        left_out = {name: why for name, why in left_out.items() if name not in STRENGTHS}
    on = {name for name in estimates if name not in left_out}
    return left_out | {name: f"contained in {container}" for name in CONTAINED if (container := _container(name, on))}


def _container(name: str, on: set[str]) -> str | None:
    """The effect among those that are on which does what `name` does, too."""
    container = CONTAINED.get(name)
    return container if container is None or container in on else _container(container, on)


def _choice(
    name: str, wanted: Wanted, missing: str, estimates: dict[str, Estimate], left_out: dict[str, str]
) -> Choice:
    if missing:
        return Choice(effect=name, on=False, why=f"needs {missing}")
    if wanted == "auto":
        on, why = name not in left_out, left_out.get(name, "called for")
    else:
        on, why = name in wanted, "listed" if name in wanted else "not listed"
    estimate = estimates.get(name)
    if estimate is None:
        return Choice(effect=name, on=on, why=why)
    level_db = estimate.level_db if np.isfinite(estimate.level_db) else None
    why, depth_mm, cost_s = f"{why} ({estimate.why})", estimate.depth_mm, estimate.cost_s
    return Choice(effect=name, on=on, why=why, depth_mm=depth_mm, level_db=level_db, cost_s=cost_s)
