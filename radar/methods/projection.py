"""Surfaces from volumes by maximum intensity projection: the state of the art that FSK is compared
with.

A projection needs little of a volume: the strongest voxel of each pixel and, between voxels, its
neighbours along z. An engine that never holds a whole volume hands over its `Peaks`. Which of two
voxels is the stronger, and which pixel is on target, is the exact image's answer: where two
candidates differ by less than the image's error allows for, both are imaged exactly (`settle_peaks`). A
faster image thus leads to the same map, unless it leaves three voxels of a pixel in doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import PixelGrid, VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.imaging.cpu.executor import ToneSkeleton
from handbench.radar.imaging.peaks import Peaks
from handbench.radar.imaging.plan import get_or_compute as kept_plan
from handbench.radar.imaging.tree import Family
from handbench.radar.methods.alignment import align, capon, coherence_factor, filter_by_agreement
from handbench.radar.methods.fsk import path_rise
from handbench.radar.methods.projection_config import AlignedConfig, ProjectionConfig

EXACT_TO = (
    1e-6  # relative error of what is called exact where voxels are compared: single precision's
)
CHECKED = 8  # tones imaged once more, to see whether a depth is an echo's
# Times the voxels' root mean square error, that a difference of two must exceed. Errors gather
# where the image is
# bright: above -13 dB of a point in a large box they were 2.2 times as large on average (measured,
# at 1e-3).
SURE = 8.0
NOISE_PASSES = 0.01  # share of noise's pixels that may pass for an echo's
SIDELOBE = 0.05  # of sinc², the pulse of an even band: 0.047

Exact = Callable[[np.ndarray, np.ndarray], np.ndarray]


def volume(capture: RadarCapture, config: ProjectionConfig, frame: int = 0) -> np.ndarray:
    """Complex image of the configured voxels: complex64 [nz, ny, nx]."""
    samples, frequencies_hz = capture.tones(config.tones_hz(), frame)
    return image_volume(samples, frequencies_hz, capture.aperture, config.grid(), config.tolerance)


def project(
    capture: RadarCapture, config: ProjectionConfig, method: str, frame: int = 0
) -> DepthMap:
    """`maximum_projection` of the configured voxels, which are never held all at once; flagged as
    well are the pixels at whose depth the tones do not agree."""
    samples, frequencies_hz = capture.tones(config.tones_hz(), frame)
    samples, grid = scaled_to_one(samples), config.grid()
    kept, reuse = _CACHE.get(({}, False))
    key = (
        id(capture),
        frame,
        frequencies_hz.tobytes(),
        config.tolerance,
        str((config.x, config.y, config.z)),
    )
    if not reuse or key not in kept:
        made = project_volume(samples, frequencies_hz, capture.aperture, grid, config.tolerance)
        kept[key] = capture, made  # the capture too: its id is another's once it is gone
    _, peaks = kept[key]

    exact = _exact(samples, frequencies_hz, capture.aperture, grid)
    peaks = settle_peaks(peaks, config.threshold_db, exact, len(grid.z_m) * config.subvoxel)
    depth = maximum_projection(peaks, config, method)
    capons = isinstance(config, AlignedConfig) and config.estimator == "capon"
    some = even_subset(len(frequencies_hz), CHECKED * (1 + capons))
    range_cells = 2 * np.ptp(frequencies_hz) * np.ptp(grid.z_m) / SPEED_OF_LIGHT_M_S
    least = least_coherence(len(frequencies_hz), len(some), range_cells)
    if least >= 1 and not isinstance(
        config, AlignedConfig
    ):  # noise aligns so few tones as well as an echo does
        return depth
    index = np.flatnonzero(np.isfinite(depth.z_m))
    points = grid.pixels.points_at_m(index, grid.z_m[peaks.index.ravel()[index]])
    images = image_points(
        samples[some], frequencies_hz[some], capture.aperture, points, None, apart=True
    )
    power = len(frequencies_hz) ** 2 * np.mean(
        np.abs(images) ** 2, axis=0
    )  # of all tones, were they in phase
    incoherent = peaks.magnitude[1].ravel()[index] ** 2 < least * power
    depth = replace(
        depth, wrapped=np.asarray(depth.wrapped) | (grid.pixels.on_map(index, incoherent, 0.0) > 0)
    )
    if not isinstance(config, AlignedConfig):
        return depth

    def image(shift_m: float) -> np.ndarray:
        return image_points(
            samples[some],
            frequencies_hz[some],
            capture.aperture,
            points + [0, 0, shift_m],
            config.tolerance,
            apart=True,
        )

    return _aligned(
        depth,
        config,
        points,
        images,
        frequencies_hz[some],
        path_rise(points, capture.aperture),
        image,
    )


def settle_peaks(peaks: Peaks, threshold_db: float, exact: Exact, beside: int = 0) -> Peaks:
    """The peaks whose strongest voxels, where pixels are at or above the threshold, are those of
    the exact image.

    exact: flat pixel index [n] and voxel index along z [n] → magnitude [n] in the exact image.
    beside: voxels along z, where the magnitudes beside a voxel that another gives way to are asked
    for, too; else they are NaN.
    """
    doubt = SURE * peaks.error
    if doubt == 0:
        return peaks
    shape, height = peaks.index.shape, peaks.magnitude[1].ravel()
    index, rival, second = peaks.index.flatten(), peaks.rival.ravel(), peaks.second.ravel()
    floor = height.max() * 10 ** (threshold_db / 20)
    rivalled = (height - second <= doubt) & (height >= floor - doubt) & (rival >= 0)
    paired = np.flatnonzero(rivalled)
    single = np.flatnonzero(
        ((np.abs(height - floor) <= doubt) | (height >= height.max() - doubt)) & ~rivalled
    )
    places = index[single], index[paired], rival[paired]
    found = exact(np.concatenate([single, paired, paired]), np.concatenate(places))
    alone, own, other = np.split(found, [len(single), len(single) + len(paired)])
    magnitude = peaks.magnitude.reshape(3, -1).copy()
    magnitude[1, single], magnitude[1, paired] = alone, np.maximum(own, other)
    moved = paired[other > own]
    index[moved] = rival[moved]
    place = index[moved] + np.array([[-1], [1]])
    within = (place >= 0) & (place < beside)
    around = np.full(place.shape, np.nan)
    if within.any():
        around[within] = exact(np.broadcast_to(moved, place.shape)[within], place[within])
    magnitude[[[0], [2]], moved] = around
    return replace(peaks, index=index.reshape(shape), magnitude=magnitude.reshape(3, *shape))


def least_coherence(count: int, known: int, range_cells: float) -> float:
    """The value that |Σ O|² / (N Σ |O|²) of the N = count tones' images O must reach at a pixel's
    strongest voxel to be an echo's: that of one depth has 1, noise 1/N on average. Of Σ |O|², n =
    `known` of the tones tell.

    Of noise, N times the ratio is F-distributed with 2 and 2n degrees of freedom, so that the
    strongest of K depths, two a range cell of the volume, exceeds x in a share K (1 + Nx/n)^(−n) of
    the pixels: NOISE_PASSES. An echo from outside the volume is seen by its range sidelobes:
    SIDELOBE at most.
    """
    depths = 1 + 2 * range_cells
    return max(known / count * ((depths / NOISE_PASSES) ** (1 / known) - 1), SIDELOBE)


def _exact(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid
) -> Exact:
    """The exact image for `settle_peaks`: voxels' magnitudes, of as many tones of an array as carry all
    the others."""

    @cache
    def few() -> tuple[np.ndarray, np.ndarray]:
        if not isinstance(aperture, AntennaArray):
            return samples, frequencies_hz
        low_m, high_m = grid.ends_m
        make = partial(ToneSkeleton, frequencies_hz, aperture, low_m, high_m, EXACT_TO)
        what = "tones", low_m, high_m
        found = kept_plan(what, frequencies_hz, aperture, Family(EXACT_TO, apart=False), make)
        return found.compress(samples), found.frequencies_hz

    def exact(index: np.ndarray, place: np.ndarray) -> np.ndarray:
        points_m = grid.pixels.points_at_m(index, grid.z_m[place])
        return np.abs(image_points(*few(), aperture, points_m, None))

    return exact


def _aligned(
    depth: DepthMap,
    config: AlignedConfig,
    points_m: np.ndarray,
    images: np.ndarray,
    frequencies_hz: np.ndarray,
    rise: np.ndarray,
    image: Callable[[float], np.ndarray],
) -> DepthMap:
    """The map with depths at which the images [f, n] at its strongest voxels, points_m [n, 3],
    agree. image: makes them anew at places shifted along z."""
    pixels, bandwidth_hz = PixelGrid(depth.x_m, depth.y_m), np.ptp(frequencies_hz)
    index, reach_m = np.flatnonzero(np.isfinite(depth.z_m)), SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz)
    found = align(images, frequencies_hz, rise)
    shift_m = found.shift_m
    if config.estimator == "capon":
        shift_m = capon(images, frequencies_hz, rise, reach_m)
    elif config.estimator == "coherence":
        shift_m = coherence_factor(image, reach_m)
    z_m, own_m = (pixels.on_map(index, told) for told in (points_m[:, 2] + shift_m, found.sigma_m))
    coherence = pixels.on_map(index, found.coherence, 1.0)
    return filter_by_agreement(
        replace(depth, z_m=z_m, sigma_m=own_m), coherence, bandwidth_hz, config
    )


_CACHE: ContextVar[tuple[dict[Any, tuple[RadarCapture, Peaks]], bool]] = ContextVar("kept peaks")


@contextmanager
def cached_peaks(
    kept: dict[Any, tuple[RadarCapture, Peaks]], reuse: bool = False
) -> Iterator[None]:
    """While it lasts, `project` keeps the peaks of its captures' volumes; reuse: and takes them
    from there, for maps that differ in filters and thresholds alone have one volume."""
    token = _CACHE.set((kept, reuse))
    try:
        yield
    finally:
        _CACHE.reset(token)


def maximum_projection(peaks: Peaks, config: ProjectionConfig, method: str) -> DepthMap:
    """Maximum intensity projection along z, of the peaks of a volume: each pixel takes the depth of
    its strongest voxel, whole voxels as in the paper or between them; pixels below the threshold
    are NaN. Flagged are the pixels whose strongest voxel is the first or the last: the echo may lie
    beyond."""
    grid = config.grid()
    db = amplitude_db(peaks.magnitude[1])
    z_m = grid.z_m[peaks.index]
    if config.subvoxel:
        z_m = z_m + config.z.step_m * peak_offset(peaks.magnitude)
    seen = db >= config.threshold_db
    z_m, at_end = np.where(seen, z_m, np.nan), seen & np.isin(peaks.index, (0, len(grid.z_m) - 1))
    return DepthMap(grid.x_m, grid.y_m, z_m, db, method, config.model_dump(), wrapped=at_end)


def peak_offset(magnitude: np.ndarray) -> np.ndarray:
    """The place of the maximum between three voxels [3, ...], in voxels about the middle one,
    within ±½; 0 where one of them is NaN, since the maximum may lie beyond the volume.

    The vertex of the parabola through their decibels: the logarithm of a band-limited main lobe is
    closer to a parabola than the lobe itself (the quartic term of sinc x over the quadratic is
    π²/20, that of its logarithm π²/30).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        before, middle, behind = np.log(magnitude.astype(np.float64))
        offset = 0.5 * (before - behind) / (before - 2 * middle + behind)
    return np.where(
        np.isfinite(offset), offset, 0.0
    )  # not for NaN, and three equal voxels have no vertex
