"""Simulation of the capture of a scene, with the effects that are on."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import TARGET, Echoes, bare_echoes
from handbench.support.parallel import one_blas_thread


@dataclass
class Stopwatch:
    """Measures the seconds of named blocks of code. The time of a block that runs inside another
    one counts only for the inner block."""

    seconds: dict[str, float] = field(default_factory=dict)
    _inner: list[float] = field(default_factory=list)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Return a context manager that adds the time of its `with` block to `seconds[name]`."""
        self._inner.append(0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self.seconds[name] = self.seconds.get(name, 0.0) + elapsed - self._inner.pop()
            if self._inner:
                self._inner[-1] += elapsed


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
        """Return the result with the samples of the empty room subtracted from every frame. Raises
        ValueError if the empty room was not simulated."""
        if self.empty is None:
            raise ValueError(
                "the empty room was not simulated; call simulate_scene with empty=True"
            )
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
    watch, on = Stopwatch(), {row.effect for row in choices if row.on}
    timed = "motion" in on or len(np.unique(scene.frequencies_hz)) < len(scene.frequencies_hz)
    with one_blas_thread():  # or the last digits would depend on the number of cores
        echoes = _applied(bare_echoes(scene, frames, tolerance), on, watch)
        room = None
        if empty:
            bare = bare_echoes(scene, 1, tolerance, echoes.levels)
            room = _capture(_applied(bare, on, Stopwatch()), timed)
    seconds = {name: watch.seconds.get(name, 0.0) for name in on}
    rows = tuple(row.model_copy(update={"seconds": seconds.get(row.effect)}) for row in choices)
    why = "the target's echoes, with what shapes them"
    base = Choice(effect=TARGET, on=True, why=why, seconds=watch.seconds[TARGET])
    return SimulatedCapture(_capture(echoes, timed), (base, *rows), room)


def _capture(echoes: Echoes, timed: bool) -> RadarCapture:
    """Return the samples as a capture. timed: with the times of tones and, if they follow each
    other, of frames."""
    scene = echoes.scene
    capture = RadarCapture(echoes.samples, scene.frequencies_hz, scene.array)
    if not timed:
        return capture
    capture = replace(capture, times_s=scene.time_s)
    if scene.frame_period_s is None or echoes.frames == 1:
        return capture
    return replace(capture, frame_times_s=scene.frame_period_s * np.arange(echoes.frames))


def _applied(echoes: Echoes, on: set[str], watch: Stopwatch) -> Echoes:
    """Apply the effects in `on`, in the order of the catalogue, and compute the samples. The
    seconds of each effect are recorded in `watch`."""
    echoes = replace(echoes, timed=watch.timed)
    for effect in EFFECTS:
        if effect.id in on:
            with watch.timed(effect.id):
                echoes = echoes.through(effect.apply)
    np.asarray(echoes.samples)  # computes them if no effect has
    return echoes
