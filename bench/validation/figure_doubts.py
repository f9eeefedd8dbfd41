"""Doubts about the figures of a depth map: values that can hardly be, in sentences."""

from collections.abc import Iterator, Mapping

import numpy as np

from handbench.bench.results.about import HEADLINE
from handbench.radar.data.depthmap import DepthMap

FAR_PERCENT = 10  # of the distance, a mean error that large is none of a surface in sight


def of_figures(depth: DepthMap, values: Mapping[str, float | int | None]) -> Iterator[str]:
    """Doubts about the figures of a map against a surface."""
    mean_mm, accuracy, z = values[HEADLINE], values["relative_accuracy_percent"], depth.config.get("z")
    box_mm = 1e3 * (z["stop_m"] - z["start_m"]) if isinstance(z, dict) and {"start_m", "stop_m"} <= z.keys() else np.inf
    cure = "is the surface in metres, and in the radar's frame? `handbench inspect` both"
    if mean_mm is None or accuracy is None:
        yield f"no pixel of the map lies before or behind the surface: {cure}"
    elif not 0 <= accuracy <= 100:
        yield f"the relative accuracy is {accuracy:.4g} %, which lies outside 0 to 100 %: {cure}"
    elif mean_mm > box_mm:
        yield f"the mean error, {mean_mm:.3g} mm, is longer than the depth box, {box_mm:.3g} mm: {cure}"
    elif accuracy < 100 - FAR_PERCENT:
        yield f"the mean error, {mean_mm:.3g} mm, is more than {FAR_PERCENT} % of the distance: {cure}"
