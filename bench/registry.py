"""The methods that turn echoes into depth maps, by id."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from radar.capture import RadarCapture
from radar.config import Config, parse, suggest
from radar.depthmap import DepthMap
from radar.errors import HandbenchError

PAPER = "Bräunig et al., An Efficient yet High-Performance Method for Precise Radar-Based Imaging of Human Hand Poses"


@dataclass(frozen=True)
class Reconstruction:
    """A depth map and, from volumetric methods, how to image the complex volume [nz, ny, nx] behind it, and its
    volume_z_m [nz]."""

    depth: DepthMap
    volume: Callable[[], np.ndarray] | None = None
    volume_z_m: np.ndarray | None = None


@dataclass(frozen=True)
class Method:
    """A method: run(capture, config, frame) → Reconstruction, with a declared configuration; a variant of the method
    `base` takes what a sensor asks of that."""

    id: str
    config: type[Config]
    run: Callable[[RadarCapture, Any, int], Reconstruction]
    summary: str
    source: str
    base: str | None = None

    def configure(self, values: dict[str, Any], where: str) -> Config:
        """The configuration from plain values; unknown keys are errors."""
        return parse(self.config, values, where)


METHODS: dict[str, Method] = {}


def register(
    id: str, config: type[Config], summary: str, source: str = PAPER, base: str | None = None
) -> Callable[[Callable[[RadarCapture, Any, int], Reconstruction]], Callable[[RadarCapture, Any, int], Reconstruction]]:
    """Decorator that adds a function run(capture, config, frame) → Reconstruction to the registry."""

    def add(
        run: Callable[[RadarCapture, Any, int], Reconstruction],
    ) -> Callable[[RadarCapture, Any, int], Reconstruction]:
        if id in METHODS:
            raise HandbenchError(f"method '{id}' is registered twice; choose another id")
        METHODS[id] = Method(id, config, run, summary, source, base)
        return run

    return add


def method(id: str) -> Method:
    """The method with this id; an unknown id names the nearest."""
    import bench.methods  # noqa: F401  the built-in methods register themselves

    if id not in METHODS:
        raise HandbenchError(f"method: unknown id '{id}'; {suggest(id, list(METHODS))}")
    return METHODS[id]


def methods() -> list[Method]:
    """All methods in the order of their registration."""
    import bench.methods  # noqa: F401

    return list(METHODS.values())
