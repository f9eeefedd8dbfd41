"""Doubts about a depth map by itself, in sentences."""

from collections.abc import Iterator

import numpy as np

from handbench.bench.datasets.native import FAR_M
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.trust import FLAGGED

CROWDED, WIDE_M = 0.5, 0.1  # share of an image that nothing near a hand fills, if it is at least that wide and high


def flagged(depth: DepthMap) -> float | None:
    """Share of the pixels on target whose p_gross is above FLAGGED; None without p_gross, or without pixels."""
    seen = np.isfinite(depth.z_m)
    return None if depth.p_gross is None or not seen.any() else float((depth.p_gross[seen] > FLAGGED).mean())


def of_map(depth: DepthMap) -> Iterator[str]:
    """Doubts about a depth map by itself."""
    share = float(np.isfinite(depth.z_m).mean())
    if share > CROWDED and min(np.ptp(depth.x_m), np.ptp(depth.y_m)) >= WIDE_M:
        yield f"{100 * share:.0f} % of the image is on target: does nothing focus? `handbench inspect` the capture"
    if float(np.nanmax(np.abs(depth.z_m), initial=0.0)) > FAR_M:
        yield f"depths lie further than {FAR_M:g} m away: are they millimetres? multiply them by 1e-3"
    if (wrong := flagged(depth) or 0.0) > CROWDED:
        yield f"{100 * wrong:.0f} % of the pixels on target are likelier wrong than right (p_gross > {FLAGGED:g})"
