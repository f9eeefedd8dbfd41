"""Simulation of a scene's echoes with the effects that are on."""

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


@dataclass
class Stopwatch:
    """Seconds per name; the time of nested blocks counts only for the inner one."""

    seconds: dict[str, float] = field(default_factory=dict)
    _inner: list[float] = field(default_factory=list)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Count the time of the block for `name`."""
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
    """A simulated capture, the rows of its effects with their seconds, and the empty room without
    the target (one frame; None: not simulated)."""

    capture: RadarCapture
    rows: tuple[Choice, ...]
    empty: RadarCapture | None = None

    def subtracted(self) -> "SimulatedCapture":
        """The capture with the empty room's samples subtracted from each frame."""
        if self.empty is None:
            raise ValueError("the empty room was not simulated")
        samples = self.capture.samples - self.empty.samples
        return replace(self, capture=replace(self.capture, samples=samples))


def simulate_scene(
    scene: EchoScene,
    choices: tuple[Choice, ...],
    frames: int = 1,
    tolerance: float | None = 1e-5,
    empty: bool = False,
) -> SimulatedCapture:
    """Simulate the capture of a scene with the chosen effects. Frames differ only by random
    effects; the empty room has the same sensor and independent noise."""
    watch, on = Stopwatch(), {row.effect for row in choices if row.on}
    echoes = _applied(bare_echoes(scene, frames, tolerance), on, watch)
    seconds = {name: watch.seconds.get(name, 0.0) for name in on}
    rows = tuple(row.model_copy(update={"seconds": seconds.get(row.effect)}) for row in choices)
    why = "the target's echoes, with what shapes them"
    base = Choice(effect=TARGET, on=True, why=why, seconds=watch.seconds[TARGET])
    room = None
    if empty:
        room = _capture(_applied(bare_echoes(scene, 1, tolerance, echoes.levels), on, Stopwatch()))
    return SimulatedCapture(_capture(echoes), (base, *rows), room)


def _capture(echoes: Echoes) -> RadarCapture:
    return RadarCapture(echoes.samples, echoes.scene.frequencies_hz, echoes.scene.array)


def _applied(echoes: Echoes, on: set[str], watch: Stopwatch) -> Echoes:
    """Apply the effects that are on, and record the seconds of each in the watch."""
    echoes = replace(echoes, timed=watch.timed)
    for effect in EFFECTS:
        if effect.id in on:
            with watch.timed(effect.id):
                echoes = effect.apply(echoes)
    np.asarray(echoes.samples)  # computes them if no effect has
    return echoes
