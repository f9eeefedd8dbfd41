"""Geometry that has no answer: each must be refused in words."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from itertools import product
from unittest.mock import patch

import numpy as np

from bench.studies.stability.cases import Works, refusal
from bench.studies.stability.geometry_direct import TONES_HZ, array, cloud
from bench.studies.stability.scenes import white_noise
from radar.data.arrays import AntennaArray
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_points, image_volume
from radar.simulation.forward import Scatterers, simulate

UP = 1e-3 * np.arange(9)


def _image(points_m: np.ndarray, tolerance: float | None) -> np.ndarray:
    return image_points(white_noise((len(TONES_HZ), *array().channels), 0), TONES_HZ, array(), points_m, tolerance)


def _imaged(value: float, tolerance: float | None) -> tuple[str, Callable[[], np.ndarray]]:
    return f"{value}, tolerance {tolerance}", partial(_image, _with(value), tolerance)


def _with(value: float) -> np.ndarray:
    """Points of which one coordinate is `value`."""
    points = cloud(5, (0, 0, 0.3))
    points[3, 1] = value
    return points


def _echo(r_m: float, tolerance: float | None) -> np.ndarray:
    points = array().tx_m[4:5] + [0, 0, r_m]
    return simulate(Scatterers(points, np.ones(1)), TONES_HZ, array(), tolerance=tolerance)


@refusal("geometry", "a scatterer on an antenna", "lies on an antenna", "leave it out")
def _on_antenna() -> Works:
    """1/R has no value at R = 0: an echo of NaN would spoil all samples."""
    return ((f"tolerance {tolerance}", partial(_echo, 0.0, tolerance)) for tolerance in (1e-5, None))


@refusal("geometry", "voxels at NaN and infinity", "points_m", "NaN or infinity")
def _voxels_nowhere() -> Works:
    """No phase: an image of NaN, or a search for their neighbours without an end."""
    return (_imaged(value, tolerance) for value, tolerance in product((-np.inf, np.inf, np.nan), (1e-3, None)))


@refusal("geometry", "voxels beyond 10⁷ m", "points_m", "expected metres")
def _voxels_beyond() -> Works:
    """Float64 rounds paths there to more than a phase of 1e-5 rad can bear."""
    return (_imaged(value, tolerance) for value, tolerance in product((1e300, 1e20, 1.1e7), (1e-3, None)))


@refusal("geometry", "antennas at NaN, infinity and beyond 10⁷ m", "tx_m", "metres")
def _antennas() -> Works:
    """As of voxels."""
    return (
        (f"at {value}", partial(AntennaArray, _with(value), _with(0.0))) for value in (1e300, 1.1e7, np.inf, np.nan)
    )


@refusal("geometry", "axes that do not ascend", "x_m", "ascending")
def _unordered() -> Works:
    """Nodes are counted from the first voxel to the last: a descending or shuffled axis has no such order."""
    for axis in (UP[:0], np.r_[UP, 0.0], UP[::-1]):
        yield f"{axis}", partial(VoxelGrid, axis, UP, 0.3 + UP)


@refusal("geometry", "an axis with NaN", "x_m")
def _axis_nowhere() -> Works:
    """As of voxels."""
    return ((f"{axis}", partial(VoxelGrid, np.array(axis), UP, UP)) for axis in ([np.nan], [0, np.nan, 1]))


@refusal("geometry", "a volume beyond the memory", "needs 8 GB", "steps 2 times larger would fit")
def _memory() -> Works:
    """8 GB of voxels under a limit of 1 GB: it is refused before anything is computed, with what would fit."""
    axis, samples = 1e-4 * np.arange(1000), white_noise((len(TONES_HZ), *array().channels), 0)
    with patch.dict(os.environ, HANDBENCH_MEMORY_GB="1"):
        yield "1 GB", partial(image_volume, samples, TONES_HZ, array(), VoxelGrid(axis, axis, 0.3 + axis), 1e-3)


@refusal("geometry", "tolerances below float32 and beyond use", "tolerance", "--exact")
def _tolerances() -> Works:
    """Below 1e-6 single precision ends, beyond 0.1 the bounds' derivation: neither could be kept."""
    return ((f"{t}", partial(_image, cloud(5, (0, 0, 0.3)), t)) for t in (np.nan, 0.11, 9e-7, 0.0))
