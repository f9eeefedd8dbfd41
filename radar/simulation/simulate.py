"""Scene → echoes, through the effects that are on."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import EFFECTS
from handbench.radar.simulation.state import EchoState

ECHOES = "echoes"  # the row of the base simulation in the table of times


@dataclass
class Stopwatch:
    """Seconds per name; the time of what is timed inside something else counts for the inner alone."""

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
    """A scene's capture, the rows of its effects with the seconds that each took, and the same room without the target
    (one frame; None: not asked for)."""

    capture: RadarCapture
    rows: tuple[Choice, ...]
    empty: RadarCapture | None = None

    def subtracted(self) -> "SimulatedCapture":
        """The capture with the empty room's samples taken from each frame."""
        if self.empty is None:
            raise ValueError("the empty room was not simulated")
        samples = self.capture.samples - self.empty.samples
        return replace(self, capture=replace(self.capture, samples=samples))


def simulate_scene(
    scene: EchoScene, choices: tuple[Choice, ...], frames: int = 1, tolerance: float | None = 1e-5, empty: bool = False
) -> SimulatedCapture:
    """The capture of a scene with the chosen effects. Frames differ in what is random from frame to frame alone; the
    empty room has the same sensor, and noise of its own."""
    watch = Stopwatch()
    state = EchoState(scene, frames, tolerance)
    _apply(state, choices, watch)
    seconds = {row.effect: watch.seconds.get(row.effect, 0.0) for row in choices if row.on}
    rows = tuple(row.model_copy(update={"seconds": seconds.get(row.effect)}) for row in choices)
    why = "the target's echoes, with what shapes them"
    base = Choice(effect=ECHOES, on=True, why=why, seconds=watch.seconds[ECHOES])
    room = None
    if empty:
        room = EchoState(scene, 1, tolerance, levels=state.levels)
        _apply(room, choices, Stopwatch())
    return SimulatedCapture(_capture(state), (base, *rows), None if room is None else _capture(room))


def _capture(state: EchoState) -> RadarCapture:
    return RadarCapture(state.samples, state.scene.frequencies_hz, state.scene.array)


def _apply(state: EchoState, choices: tuple[Choice, ...], watch: Stopwatch) -> None:
    on = {row.effect for row in choices if row.on}
    state.echo = _timed(state.echo, ECHOES, watch)  # type: ignore[method-assign]
    for effect in EFFECTS:
        if effect.id not in on:
            continue
        known = len(state.extra)
        with watch.timed(effect.id):
            effect.apply(state)
        state.extra[known:] = [_timed(extra, effect.id, watch) for extra in state.extra[known:]]
    np.asarray(state.samples)  # computes them where no effect has asked


def _timed(echo: Callable[..., np.ndarray], name: str, watch: Stopwatch) -> Callable[..., np.ndarray]:
    def timed(*arguments: AntennaArray) -> np.ndarray:
        with watch.timed(name):
            return echo(*arguments)

    return timed
