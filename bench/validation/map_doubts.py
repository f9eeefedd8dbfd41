"""Doubts about a depth map by itself, and about its figures: what can hardly be, in sentences."""

from collections.abc import Iterator, Mapping

import numpy as np

from bench.results.about import HEADLINE
from radar.data.depthmap import DepthMap
from radar.methods.trust import FLAGGED

CROWDED, WIDE_M = 0.5, 0.1  # share of an image that nothing near a hand fills, if it is at least that wide and high
FAR_PERCENT = 10  # of the distance, a mean error that large is none of a surface in sight


def flagged(depth: DepthMap) -> float | None:
    """Share of the pixels on target whose p_gross is above FLAGGED; None without p_gross, or without pixels."""
    seen = np.isfinite(depth.z_m)
    return None if depth.p_gross is None or not seen.any() else float((depth.p_gross[seen] > FLAGGED).mean())


def of_map(depth: DepthMap) -> Iterator[str]:
    """Doubts about a depth map by itself."""
    share = float(np.isfinite(depth.z_m).mean())
    if share > CROWDED and min(np.ptp(depth.x_m), np.ptp(depth.y_m)) >= WIDE_M:
        yield f"{100 * share:.0f} % of the image is on target: does nothing focus? `handbench inspect` the capture"
    if (wrong := flagged(depth) or 0.0) > CROWDED:
        yield f"{100 * wrong:.0f} % of the pixels on target are likelier wrong than right (p_gross > {FLAGGED:g})"


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
