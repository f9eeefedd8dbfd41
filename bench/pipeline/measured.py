"""Depth maps of measured captures by the methods that their descriptions set up, and the figures
that need no reference surface."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import captures, open_capture
from handbench.bench.pipeline.image import configuration, image
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

STRONG_DB = -6.0  # pixels that count: above half of the strongest one's amplitude


@dataclass(frozen=True)
class MeasuredImage:
    """The depth map of a capture by a method. distance_m: that of the target as the capture's
    description states it; seconds: that the image took."""

    capture: str
    method: str
    depth: DepthMap
    distance_m: float | None
    seconds: float

    @property
    def strong(self) -> np.ndarray:
        """Mask [ny, nx] of the pixels with a depth above STRONG_DB."""
        return np.isfinite(self.depth.z_m) & (self.depth.amplitude_db >= STRONG_DB)

    @property
    def median_m(self) -> float:
        """Median depth of the strong pixels."""
        return float(np.median(self.depth.z_m[self.strong]))

    @property
    def std_m(self) -> float:
        """Standard deviation of the strong pixels' depths, which is flatness on a flat target."""
        return float(self.depth.z_m[self.strong].std())

    @property
    def strongest_m(self) -> np.ndarray:
        """Position [3] of the strongest pixel."""
        level_db = np.where(self.strong, self.depth.amplitude_db, -np.inf)
        row, column = np.unravel_index(level_db.argmax(), level_db.shape)
        return np.array([self.depth.x_m[column], self.depth.y_m[row], self.depth.z_m[row, column]])


def image_measured(folder: str | Path) -> Iterator[MeasuredImage]:
    """Image the first frame of all captures in a folder, by each method in their
    `[capture.methods]`. Raises HandbenchError if no capture names a method."""
    found = False
    for path in captures(folder):
        capture = open_capture(path)
        if not capture.about.methods:
            continue
        found, echoes = True, capture.echoes(1)
        for id in capture.about.methods:
            settings = configuration(path, id, {})
            start = time.perf_counter()
            depth = image(echoes, method(id), settings)
            seconds = time.perf_counter() - start
            say(f"{path}: imaged by {id}")
            yield MeasuredImage(capture.about.name, id, depth, capture.about.distance_m, seconds)
    if not found:
        raise HandbenchError(
            f"{folder}: has no capture that sets up a method; expected tables [capture.methods.ID] "
            "in a mapping.toml, as in docs/own_data.md"
        )
