"""What of a method's time is imaging, and how many terms its images sum: nothing is kept unless somebody asks."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from math import prod
from typing import Any, TypeVar

Image = TypeVar("Image", bound=Callable[..., Any])


@dataclass
class Laps:
    """imaging_s: seconds spent in imaging; terms: complex products that the plain sums of these images have, one for
    each point, tone and channel; tones: most that one of them summed."""

    imaging_s: float = 0.0
    terms: int = 0
    tones: int = 0


_laps: ContextVar[Laps | None] = ContextVar("laps", default=None)


@contextmanager
def watch() -> Iterator[Laps]:
    """Yield what the images made in the block, by this thread, add up to."""
    laps = Laps()
    token = _laps.set(laps)
    try:
        yield laps
    finally:
        _laps.reset(token)


def imaging(function: Image) -> Image:
    """Decorator of an imaging function (samples, frequencies_hz, aperture, points or grid, …). One that calls another
    counts once."""

    @wraps(function)
    def timed(samples: Any, frequencies_hz: Any, aperture: Any, where: Any, *others: Any, **named: Any) -> Any:
        laps = _laps.get()
        if laps is None:
            return function(samples, frequencies_hz, aperture, where, *others, **named)
        token, start = _laps.set(None), time.perf_counter()
        try:
            return function(samples, frequencies_hz, aperture, where, *others, **named)
        finally:
            _laps.reset(token)
            laps.imaging_s += time.perf_counter() - start
            points = where.size // 3 if hasattr(where, "size") else prod(where.shape)
            laps.terms += samples.size * points
            laps.tones = max(laps.tones, len(samples))

    return timed  # type: ignore[return-value]
