"""Predicted time and memory of depth maps: counts of operations, multiplied by measured rates."""

from typing import NamedTuple

import numpy as np

from handbench.groundtruth.dense import patchmatch
from handbench.groundtruth.dense.views import View

# that an iteration tries at a pixel
HYPOTHESES = len(patchmatch.DIRECTIONS) + patchmatch.PERTURBATIONS
# processor time on a shared core of an AMD EPYC: of a sweep, for each pixel, plane and source view;
# of a window that PatchMatch compares
SWEEP_S, MATCH_S = (1.4e-8, 1.8e-7)
# a pixel: depth and normal; picture, nearest and farthest depth, with the halved ones
MAP_BYTES, VIEW_BYTES = (32, 15)
SWEEP_BYTES = 4  # a plane and pixel
FUSED_BYTES, FUSED_ALONE = 58, 72  # a pixel of each map, and of the one that is fused
LIBRARY_BYTES = 3e8  # kernels and imported libraries


class Prediction(NamedTuple):
    """Predicted cost of computing depth maps.

    pixels: number to match, over all views. most_planes: largest number of planes in a sweep.
    seconds: processor time on the machine of the rates, summed over threads.
    bytes_: additional memory at the peak, fusion included.
    """

    pixels: int
    views: int
    most_planes: int
    seconds: float
    bytes_: float

    def describe(self) -> str:
        """Describe the predicted cost in one line."""
        return (
            f"dense: {self.views} views, {self.pixels / 1e6:.2f} MP to match, up to "
            f"{self.most_planes} planes: about "
            f"{self.seconds:.0f} s of processor time and {self.bytes_ / 1e9:.2g} GB"
        )


def predict_cost(
    views: list[View], sources: int, planes: list[int], iterations: list[int], sweeps: int = 1
) -> Prediction:
    """Predict processor time and memory for the depth maps of all views.

    sources: number of source views of each view. planes: for each view, number of planes swept at
    half the resolution. iterations: number of iterations of each run of PatchMatch. sweeps: number
    of directions that are swept.
    """
    sizes = np.array([view.gray.size for view in views])
    wanted = np.array([int(np.isfinite(view.near_m).sum()) for view in views])
    swept = float((sizes / 4 * planes).sum()) * sources * sweeps
    compared = sweeps / 4 * _matches(sources, 0) if sweeps > 1 else 0  # at half the resolution
    matched = float(wanted.sum()) * (compared + sum(_matches(sources, each) for each in iterations))
    sweep_bytes = SWEEP_BYTES * float((sizes / 4 * planes).max())
    fused_bytes = float((FUSED_BYTES * len(views) + FUSED_ALONE) * sizes.max())
    kept_bytes = float((MAP_BYTES + VIEW_BYTES) * sizes.sum())
    seconds = SWEEP_S * swept + MATCH_S * matched
    peak_bytes = LIBRARY_BYTES + kept_bytes + max(sweep_bytes, fused_bytes)
    return Prediction(int(wanted.sum()), len(views), max(planes), seconds, peak_bytes)


def _matches(sources: int, iterations: int) -> int:
    """Count the windows that PatchMatch compares at one pixel in a run of `iterations` iterations:
    those in all source views for the current plane, and in the better half of them for each other
    plane tried."""
    half = max(1, sources // 2)
    return sources + iterations * (sources + HYPOTHESES * half) + (sources + 2 * half)
