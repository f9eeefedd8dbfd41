"""Geometry that has no answer: each must be refused in words."""

from __future__ import annotations

import os
from collections.abc import Callable
from unittest.mock import patch

import numpy as np

from bench.studies.stability.cases import Refused, Worst, case, refused, worst
from bench.studies.stability.geometry_direct import TONES_HZ, array, cloud, noise
from radar.data.arrays import AntennaArray
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_points, image_volume
from radar.simulation.forward import Scatterers, simulate

UP = 1e-3 * np.arange(9)


def _image(points_m: np.ndarray, tolerance: float | None) -> np.ndarray:
    return image_points(noise((len(TONES_HZ), *array().channels), 0), TONES_HZ, array(), points_m, tolerance)


def _with(value: float) -> np.ndarray:
    """Points of which one coordinate is `value`."""
    points = cloud(5, (0, 0, 0.3))
    points[3, 1] = value
    return points


def _volume(memory_gb: str) -> np.ndarray:
    axis = 1e-4 * np.arange(1000)
    with patch.dict(os.environ, HANDBENCH_MEMORY_GB=memory_gb):
        samples = noise((len(TONES_HZ), *array().channels), 0)
        return image_volume(samples, TONES_HZ, array(), VoxelGrid(axis, axis, 0.3 + axis), 1e-3)


def _antenna_at(value: float) -> AntennaArray:
    return AntennaArray(_with(value), _with(0.0))


def _echo(r_m: float, tolerance: float | None) -> np.ndarray:
    points = array().tx_m[4:5] + [0, 0, r_m]
    return simulate(Scatterers(points, np.ones(1)), TONES_HZ, array(), tolerance=tolerance)


HARD: dict[str, tuple[str, tuple[Callable[[], object], ...], tuple[str, ...]]] = {
    "a scatterer on an antenna": (
        "1/R has no value at R = 0: an echo of NaN would spoil all samples",
        (lambda: _echo(0.0, None), lambda: _echo(0.0, 1e-5)),
        ("lies on an antenna", "leave it out"),
    ),
    "voxels at NaN and infinity": (
        "no phase: an image of NaN, or a search for their neighbours without an end",
        tuple(lambda v=v, t=t: _image(_with(v), t) for v in (np.nan, np.inf, -np.inf) for t in (None, 1e-3)),
        ("points_m", "NaN or infinity"),
    ),
    "voxels beyond 10⁷ m": (
        "float64 rounds paths there to more than a phase of 1e-5 rad can bear",
        tuple(lambda v=v, t=t: _image(_with(v), t) for v in (1.1e7, 1e20, 1e300) for t in (None, 1e-3)),
        ("points_m", "expected metres"),
    ),
    "antennas at NaN, infinity and beyond 10⁷ m": (
        "as of voxels",
        tuple(lambda v=v: _antenna_at(v) for v in (np.nan, np.inf, 1.1e7, 1e300)),
        ("tx_m", "metres"),
    ),
    "axes that do not ascend": (
        "nodes are counted from the first voxel to the last: a descending or shuffled axis has no such order",
        tuple(lambda axis=axis: VoxelGrid(axis, UP, 0.3 + UP) for axis in (UP[::-1], np.r_[UP, 0.0], UP[:0])),
        ("x_m", "ascending"),
    ),
    "an axis with NaN": (
        "as of voxels",
        tuple(lambda axis=axis: VoxelGrid(np.array(axis), UP, UP) for axis in ([0, np.nan, 1], [np.nan])),
        ("x_m",),
    ),
    "a volume beyond the memory": (
        "8 GB of voxels under a limit of 1 GB: it is refused before anything is computed, with what would fit",
        (lambda: _volume("1"),),
        ("needs 8 GB", "steps 2 times larger would fit"),
    ),
    "tolerances below float32 and beyond use": (
        "below 1e-6 single precision ends, beyond 0.1 the bounds' derivation: neither could be kept",
        tuple(lambda t=t: _image(cloud(5, (0, 0, 0.3)), t) for t in (0.0, 9e-7, 0.11, np.nan)),
        ("tolerance", "--exact"),
    ),
}


def _enter(name: str, why: str, works: tuple[Callable[[], object], ...], words: tuple[str, ...]) -> None:
    @case("geometry", name, quantity="an answer", reference="a refusal", unit="answers", bound=0.0, reason=why)
    def measure() -> Refused | Worst:
        answers = [refused(work, *words) for work in works]
        wrong = [(answer.at, answer.value) for answer in answers if isinstance(answer, Worst)]
        return worst(wrong) if wrong else answers[0]


for _name, _hard in HARD.items():
    _enter(_name, *_hard)
