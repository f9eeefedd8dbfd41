"""Maximum intensity projection (MIP) of volumes to surfaces: the established methods that FSK is
compared with.

A projection needs only the strongest voxel of each pixel and, for depths between voxels, its
neighbours along z (`Peaks`); imaging finds these without storing the volume. Where the image's
error could decide which of two voxels is the strongest, or whether a pixel passes the threshold,
these voxels are imaged exactly (`settle_peaks`). So a faster, less accurate image leads to the same
map, unless three voxels of a pixel differ by less than the error.
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
from handbench.radar.methods.alignment import align, filter_by_agreement
from handbench.radar.methods.fsk import path_rise
from handbench.radar.methods.projection_config import AlignedConfig, ProjectionConfig

# relative error of the exact image in comparisons: single precision
EXACT_TO = 1e-6
CHECKED = 8  # tones that are imaged again, to tell echoes from noise
# A difference of two voxels is certain above this many times their root mean square error. Errors
# are larger where the image is bright: 2.2 times on average above -13 dB of a point in a large box
# (measured, at 1e-3).
SURE = 8.0
NOISE_PASSES = 0.01  # share of noise pixels that may pass as echoes
SIDELOBE = 0.05  # of sinc², the pulse of an even band: 0.047

Exact = Callable[[np.ndarray, np.ndarray], np.ndarray]


def volume(capture: RadarCapture, config: ProjectionConfig, frame: int = 0) -> np.ndarray:
    """Image the configured voxels at the configured tones: complex64 [nz, ny, nx]."""
    samples, frequencies_hz = capture.tones(config.tones_hz(), frame)
    return image_volume(samples, frequencies_hz, capture.aperture, config.grid(), config.tolerance)


def project(
    capture: RadarCapture, config: ProjectionConfig, method: str, frame: int = 0
) -> DepthMap:
    """Compute the depth map of a frame by maximum intensity projection, without storing the volume.
    With an `AlignedConfig`, each depth is refined to the one at which the tones' phases agree.

    method: id that is stored in the map. Pixels are flagged if their strongest voxel is the first
    or the last along z, or if their tones are too incoherent there for an echo.
    """
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
        kept[key] = capture, made  # holds the capture, so that its id stays unique
    _, peaks = kept[key]

    exact = _exact(samples, frequencies_hz, capture.aperture, grid)
    peaks = settle_peaks(peaks, config.threshold_db, exact, len(grid.z_m) * config.subvoxel)
    depth = maximum_projection(peaks, config, method)
    some = even_subset(len(frequencies_hz), CHECKED)
    range_cells = 2 * np.ptp(frequencies_hz) * np.ptp(grid.z_m) / SPEED_OF_LIGHT_M_S
    least = least_coherence(len(frequencies_hz), len(some), range_cells)
    # noise aligns so few tones as well as an echo does
    if least >= 1 and not isinstance(config, AlignedConfig):
        return depth
    index = np.flatnonzero(np.isfinite(depth.z_m))
    points = grid.pixels.points_at_m(index, grid.z_m[peaks.index.ravel()[index]])
    images = image_points(
        samples[some], frequencies_hz[some], capture.aperture, points, None, apart=True
    )
    # the power of all tones in phase
    power = len(frequencies_hz) ** 2 * np.mean(np.abs(images) ** 2, axis=0)
    incoherent = peaks.magnitude[1].ravel()[index] ** 2 < least * power
    depth = replace(
        depth, wrapped=np.asarray(depth.wrapped) | (grid.pixels.on_map(index, incoherent, 0.0) > 0)
    )
    if not isinstance(config, AlignedConfig):
        return depth
    rise = path_rise(points, capture.aperture)
    return _aligned(depth, config, points, images, frequencies_hz[some], rise)


def settle_peaks(peaks: Peaks, threshold_db: float, exact: Exact, beside: int = 0) -> Peaks:
    """Correct the strongest voxels of an approximate image to those of the exact image, for pixels
    at or above the threshold. Voxels are imaged exactly where the error of the image could change
    the result.

    exact: function (flat pixel indices [n], indices along z [n]) → magnitudes [n] in the exact
    image. beside: number of voxels along z, if the magnitudes of the voxels before and behind a
    corrected peak are needed; with 0 they become NaN.
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
    """Compute the threshold of the coherence |Σ O|² / (N Σ |O|²) of the images O of N = count
    tones, above which the strongest voxel of a pixel counts as an echo. A target at one depth has
    coherence 1, noise 1/N on average.

    Σ |O|² is estimated from n = `known` of the tones; range_cells: depth of the volume in range
    cells c/2B. For noise, N times the coherence is F-distributed with 2 and 2n degrees of freedom,
    so that of the strongest of K depths, two per range cell, exceeds x in a share K (1 + Nx/n)^(−n)
    of the pixels; the threshold is the x at which this share is NOISE_PASSES. It is at least
    SIDELOBE, since an echo from outside the volume appears with its range sidelobes.
    """
    depths = 1 + 2 * range_cells
    return max(known / count * ((depths / NOISE_PASSES) ** (1 / known) - 1), SIDELOBE)


def _exact(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid
) -> Exact:
    """Return the function that `settle_peaks` calls for exact magnitudes: (flat pixel indices [n],
    indices along z [n]) → magnitudes [n]. For an antenna array, it sums only the few tones of which
    all others are linear combinations to single precision."""

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
) -> DepthMap:
    """Return the depth map with the depths at which the tones' images agree, their predicted 1σ and
    flags, averaged over neighbouring pixels.

    points_m [n, 3]: strongest voxels of the n pixels with a depth; images [f, n]: images at these
    points; rise [n]: growth of the path there and back per metre along z.
    """
    pixels, bandwidth_hz = PixelGrid(depth.x_m, depth.y_m), np.ptp(frequencies_hz)
    index, found = np.flatnonzero(np.isfinite(depth.z_m)), align(images, frequencies_hz, rise)
    z_m, own_m = (
        pixels.on_map(index, values) for values in (points_m[:, 2] + found.shift_m, found.sigma_m)
    )
    coherence = pixels.on_map(index, found.coherence, 1.0)
    return filter_by_agreement(
        replace(depth, z_m=z_m, sigma_m=own_m), coherence, bandwidth_hz, config
    )


_CACHE: ContextVar[tuple[dict[Any, tuple[RadarCapture, Peaks]], bool]] = ContextVar("kept peaks")


@contextmanager
def cached_peaks(
    kept: dict[Any, tuple[RadarCapture, Peaks]], reuse: bool = False
) -> Iterator[None]:
    """Run the `with` block so that `project` stores the strongest voxels of each volume in the
    dictionary `kept`. With `reuse`, it also takes them from there, for maps that differ only in
    filters and thresholds."""
    token = _CACHE.set((kept, reuse))
    try:
        yield
    finally:
        _CACHE.reset(token)


def maximum_projection(peaks: Peaks, config: ProjectionConfig, method: str) -> DepthMap:
    """Convert the strongest voxels of a volume to a depth map: each pixel has the depth of its
    strongest voxel, as in the paper, or with `config.subvoxel` a depth between voxels; pixels
    weaker than the threshold are NaN.

    method: id that is stored in the map. Pixels whose strongest voxel is the first or the last
    along z are flagged, since the echo may be outside the volume.
    """
    grid = config.grid()
    db = amplitude_db(peaks.magnitude[1])
    z_m = grid.z_m[peaks.index]
    if config.subvoxel:
        z_m = z_m + config.z.step_m * peak_offset(peaks.magnitude)
    seen = db >= config.threshold_db
    z_m, at_end = np.where(seen, z_m, np.nan), seen & np.isin(peaks.index, (0, len(grid.z_m) - 1))
    return DepthMap(grid.x_m, grid.y_m, z_m, db, method, config.model_dump(), wrapped=at_end)


def peak_offset(magnitude: np.ndarray) -> np.ndarray:
    """Compute the position of the maximum between three neighbouring voxels from their magnitudes
    [3, ...], relative to the middle one, in voxels: within ±½ if the middle one is the strongest.
    It is 0 where a magnitude is NaN, since the maximum may be outside the volume.

    It is the vertex of the parabola through the logarithms of the magnitudes: the logarithm of a
    band-limited main lobe is closer to a parabola than the lobe itself (the quartic term of sinc x
    over the quadratic is π²/20, that of its logarithm π²/30).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        before, middle, behind = np.log(magnitude.astype(np.float64))
        offset = 0.5 * (before - behind) / (before - 2 * middle + behind)
    return np.where(np.isfinite(offset), offset, 0.0)  # three equal voxels have no vertex
