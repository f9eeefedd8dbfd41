"""Simulation of the capture of a scene, with the effects that are on."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.catalogue import RECORDING, SHAPING
from handbench.radar.simulation.effects.motion import moving_samples
from handbench.radar.simulation.scene import Choice, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes
from handbench.support.parallel import one_blas_thread

TARGET = "echoes"  # row of the target's own echoes in the table of effects and times


@dataclass(frozen=True)
class SimulatedCapture:
    """The result of a simulation.

    rows: the target's own echoes first, then one row per effect: whether it was on, why, and the
    seconds it took; empty: a capture of the same room without the target, with one frame (None if
    it was not simulated).
    """

    capture: RadarCapture
    rows: tuple[Choice, ...]
    empty: RadarCapture | None = None

    def subtracted(self) -> "SimulatedCapture":
        """Return the result with the samples of the empty room subtracted from every frame."""
        assert self.empty is not None, "the empty room was not simulated"
        samples = self.capture.samples - self.empty.samples
        return replace(self, capture=replace(self.capture, samples=samples))


def simulate_scene(
    scene: EchoScene,
    choices: tuple[Choice, ...],
    frames: int = 1,
    tolerance: float | None = 1e-5,
    empty: bool = False,
) -> SimulatedCapture:
    """Simulate the capture of a scene with the effects that are on in `choices`.

    frames: number of frames; they differ only in what is random over time, such as noise.
    tolerance: relative error of the fast summation over scatterers (None: the exact sum, slow).
    empty: also simulate the room without the target, with the same sensor errors but another
    realisation of the noise.
    """
    on = {row.effect for row in choices if row.on}
    shape = (frames + empty, len(scene.frequencies_hz), *scene.array.channels)
    seconds: dict[str, float] = {}

    def timed(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        start = time.perf_counter()
        result = function(*arguments)
        seconds[name] = time.perf_counter() - start
        return result

    with one_blas_thread():  # or the last digits would depend on the number of cores
        echoes = bare_echoes(scene, frames, tolerance, empty)
        for effect in SHAPING:
            if effect.id in on:
                timed(effect.id, echoes.shape, effect.apply)
        samples = np.zeros(shape, np.complex64)
        sums = moving_samples if echoes.moving else Echoes.samples
        samples[:frames] = timed(TARGET, sums, echoes)
        for effect in RECORDING:
            if effect.id in on:
                samples = timed(effect.id, effect.apply, echoes, samples)
    why = "the target's echoes, with what shapes them"
    rows = (Choice(effect=TARGET, on=True, why=why), *choices)
    return SimulatedCapture(
        _capture(scene, samples[:frames], echoes.moving),
        tuple(row.model_copy(update={"seconds": seconds.get(row.effect)}) for row in rows),
        _capture(scene, samples[frames:], echoes.moving) if empty else None,
    )


def _capture(scene: EchoScene, samples: np.ndarray, moving: bool) -> RadarCapture:
    """Return the samples as a capture. It has the times of tones if the target moves or a tone is
    repeated, and then those of frames if they follow each other."""
    capture = RadarCapture(samples, scene.frequencies_hz, scene.array)
    if not moving and len(np.unique(scene.frequencies_hz)) == len(scene.frequencies_hz):
        return capture
    capture = replace(capture, times_s=scene.time_s)
    if scene.frame_period_s is None or len(samples) == 1:
        return capture
    return replace(capture, frame_times_s=scene.frame_period_s * np.arange(len(samples)))
