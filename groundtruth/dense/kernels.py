"""Compilation of the functions for matching before they are needed. It takes about
twenty seconds, once per machine; later runs read the cache of compiled code."""

import numpy as np

from handbench.groundtruth.dense import patchmatch, planesweep
from handbench.groundtruth.dense.dense import depth_maps
from handbench.groundtruth.dense.views import View
from handbench.support.compiled import announce_compilation


def announce() -> None:
    """Say that the functions for matching are compiled now, if the cache of compiled
    code lacks them."""
    announce_compilation(planesweep._correlate, patchmatch._pass)


def compile_kernels() -> None:
    """Compute depth maps of three small random pictures, so that later measured times
    contain neither compilation nor loading from the cache."""
    announce()
    K, depth_m = np.array([[60.0, 0, 20], [0, 60, 20], [0, 0, 1]]), np.ones((40, 40), np.float32)
    gray = np.random.default_rng(0).random((3, 40, 40), dtype=np.float32)
    steps_m = np.array([[0.0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]])
    views = [
        View("", gray[i], K, np.eye(3), steps_m[i], 0.9 * depth_m, 1.1 * depth_m) for i in range(3)
    ]
    depth_maps(views, [[1, 2], [0, 2], [0, 1]], 1, 0)
