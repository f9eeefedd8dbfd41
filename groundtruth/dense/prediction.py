"""Predicted time and memory of depth maps: counts of operations, multiplied by this machine's
speed, which is measured on a small part of a view."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from handbench.groundtruth.dense import patchmatch, planesweep
from handbench.groundtruth.dense.views import Stereo, View
from handbench.support.compiled import get_num_threads, set_num_threads

TRIAL_PX, TRIAL_PLANES, TRIALS = 96, 64, 4
# that an iteration tries at a pixel
HYPOTHESES = len(patchmatch.DIRECTIONS) + patchmatch.PERTURBATIONS
# processor time of large pictures relative to the trial's, measured on three dense stages
SWEPT, MATCHED = (1.4, 0.3)
# a pixel: depth and normal; picture, nearest and farthest depth, with the halved ones
MAP_BYTES, VIEW_BYTES = (32, 15)
SWEEP_BYTES = 4  # a plane and pixel
FUSED_BYTES, FUSED_ALONE = 58, 72  # a pixel of each map, and of the one that is fused
LIBRARY_BYTES = 3e8  # kernels and imported libraries


class Prediction(NamedTuple):
    """Predicted cost of computing depth maps.

    pixels: number to match, over all views. most_planes: largest number of planes in a sweep.
    seconds: processor time, summed over threads, so that other load on the machine does not matter.
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
    views: list[View],
    stereo: Stereo,
    sources: int,
    planes: list[int],
    iterations: list[int],
    sweeps: int = 1,
) -> Prediction:
    """Predict processor time and memory for the depth maps of all views, from the speed measured on
    a small part of the first view.

    stereo: the first view's picture with its sources. sources: number of source views of each view.
    planes: for each view, number of planes swept at half the resolution. iterations: number of
    iterations of each run of PatchMatch. sweeps: number of directions that are swept.
    """
    sizes = np.array([view.gray.size for view in views])
    wanted = np.array([int(np.isfinite(view.near_m).sum()) for view in views])
    sweep_s, match_s = _rates(views[0], stereo)
    swept = float((sizes / 4 * planes).sum()) * sources * sweeps
    compared = sweeps / 4 * _matches(sources, 0) if sweeps > 1 else 0  # at half the resolution
    matched = float(wanted.sum()) * (compared + sum(_matches(sources, each) for each in iterations))
    sweep_bytes = SWEEP_BYTES * float((sizes / 4 * planes).max())
    fused_bytes = float((FUSED_BYTES * len(views) + FUSED_ALONE) * sizes.max())
    kept_bytes = float((MAP_BYTES + VIEW_BYTES) * sizes.sum())
    seconds = SWEPT * sweep_s * swept + MATCHED * match_s * matched
    peak_bytes = LIBRARY_BYTES + kept_bytes + max(sweep_bytes, fused_bytes)
    return Prediction(int(wanted.sum()), len(views), max(planes), seconds, peak_bytes)


def _matches(sources: int, iterations: int) -> int:
    """Count the windows that PatchMatch compares at one pixel in a run of `iterations` iterations:
    those in all source views for the current plane, and in the better half of them for each other
    plane tried."""
    half = max(1, sources // 2)
    return sources + iterations * (sources + HYPOTHESES * half) + (sources + 2 * half)


def _rates(view: View, stereo: Stereo) -> tuple[float, float]:
    """Measure the speed of matching on a small part of a view, in seconds of processor time.

    Returns the time of the plane sweep for each pixel, plane and source, and the time of PatchMatch
    for each window that it compares. A first run, which loads or compiles the functions, is not
    counted.
    """
    y, x = np.median(np.argwhere(np.isfinite(view.near_m)), axis=0).astype(int)
    top, left = (max(0, middle - TRIAL_PX // 2) for middle in (y, x))
    shift = np.array([[1.0, 0, left], [0, 1, top], [0, 0, 1]])
    part = (slice(top, top + TRIAL_PX), slice(left, left + TRIAL_PX))
    small = stereo._replace(
        reference=np.ascontiguousarray(stereo.reference[part]), A=stereo.A @ shift
    )
    depths_m = (float(np.nanmedian(depth_m)) for depth_m in (view.far_m, view.near_m))
    low, high = (
        np.full(small.reference.shape, 1 / (z * stereo.unit), np.float32) for z in depths_m
    )
    disparity = float((low[0, 0] + high[0, 0]) / 2)
    planes = np.zeros((*small.reference.shape, 3), np.float32)
    planes[..., 0] = disparity
    sources = len(stereo.sources)
    sweep_s = _fastest(lambda: planesweep.swept_disparity(small, disparity, TRIAL_PLANES))
    match_s = _fastest(lambda: patchmatch.refine(small, planes.copy(), low, high, 0, 0))
    return (
        sweep_s / (small.reference.size * TRIAL_PLANES * sources),
        match_s / (small.reference.size * sources),
    )


def _fastest(work: Callable[[], object]) -> float:
    threads, seconds = get_num_threads(), []
    set_num_threads(1)  # others would wait for it, and count as work
    try:
        work()
        for _ in range(TRIALS):
            start = time.process_time()
            work()
            seconds.append(time.process_time() - start)
    finally:
        set_num_threads(threads)
    return min(seconds)
