"""Volumes tile by tile, with as many tones as each tile needs.

Seen from a tile's centre, path differences are at most ±d, so that tones closer than about π/d tell the same story: a
skeleton of K tones carries all of them (128 → 10–13 at a tolerance of 1e-6). Per tile,

    S₁[m] = Σ_f L[m, f] e^{j(k_f − k_m)(|c₀ − t| + |c₀ − r|)} S_f,    O(p) = Σ_m a_m(p)ᵀ S₁[m] b_m(p).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.backprojection import block_image, check_samples, stack
from radar.grid import VoxelGrid
from radar.parallel import for_each
from radar.progress import track
from radar.skeleton import skeleton

SUPERTILE = (96, 72, 72)  # voxels along z, y, x: tones are compressed once for many tiles ...
TILE = (24, 20, 20)  # ... and then again, for each tile from its supertile's few
BLOCK = 256

Box = tuple[slice, ...]


def image_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None = 1e-6,
) -> np.ndarray:
    """Complex image of a whole volume: complex64 [nz, ny, nx].

    tolerance: largest relative error of a tone's phase history in the skeleton; None sums every tone (exact).
    """
    check_samples(samples, frequencies_hz, aperture)
    volume = np.empty(grid.shape, np.complex64)
    whole = tuple(slice(0, n) for n in grid.shape)
    for super_box in track(_boxes(whole, SUPERTILE), "volume"):
        s, f = compress_tones(samples, frequencies_hz, aperture, _corners(grid, super_box), tolerance)

        def work(box: Box, s: np.ndarray = s, f: np.ndarray = f) -> None:
            tile_s, tile_f = compress_tones(s, f, aperture, _corners(grid, box), tolerance)
            part = _part(grid, box)
            points = np.ascontiguousarray(part.points_m().reshape(-1, 3).T)
            volume[box] = _image_tile(tile_s, tile_f, aperture, points).reshape(part.shape)

        for_each(work, _boxes(super_box, TILE))
    return volume


def _image_tile(samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, points: np.ndarray) -> np.ndarray:
    image = np.zeros(points.shape[1], np.complex64)
    stacked = [stack(s) for s in samples]
    for start in range(0, len(image), BLOCK):
        block = np.ascontiguousarray(points[:, start : start + BLOCK])
        for s, f in zip(stacked, frequencies_hz, strict=True):
            image[start : start + BLOCK] += block_image(s, f, aperture, block)
    return image


def compress_tones(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    corners_m: np.ndarray,
    tolerance: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Samples at a skeleton of the tones that images the box with corners_m [3, 8] as all tones do:
    ([k, t, r] or [k, n], [k]). With tolerance None, or where nothing can be saved, the input itself."""
    if tolerance is None or len(frequencies_hz) <= 3:
        return samples, frequencies_hz
    centre = corners_m.mean(axis=1, keepdims=True)
    wavenumber = 2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S
    legs = aperture.legs_m
    reach_m = sum(np.abs(_distance(corners_m, leg) - _distance(centre, leg)).max() for leg in legs)
    gram = np.sinc(reach_m * (wavenumber[:, None] - wavenumber) / np.pi)
    chosen, weights = skeleton(gram, tolerance)
    centre_legs = [_distance(centre, leg)[:, 0] for leg in legs]
    at_centre = _modulate(samples, wavenumber, centre_legs).reshape(len(samples), -1)
    compressed = (weights.astype(np.float32) @ at_centre.view(np.float32)).view(np.complex64)
    compressed = compressed.reshape(len(chosen), *samples.shape[1:])
    return _modulate(compressed, -wavenumber[chosen], centre_legs), frequencies_hz[chosen]


def _distance(points_m: np.ndarray, antennas_m: np.ndarray) -> np.ndarray:
    """Distances [a, n] of antennas [a, 3] to points [3, n]."""
    return np.sqrt(((antennas_m[:, :, None] - points_m[None]) ** 2).sum(axis=1))


def _modulate(samples: np.ndarray, wavenumber: np.ndarray, legs_m: list[np.ndarray]) -> np.ndarray:
    """samples · e^{jk(leg + leg')}: complex64; phases are formed in float64."""
    first, second = (np.exp(1j * np.outer(wavenumber, leg)).astype(np.complex64) for leg in legs_m)
    if samples.ndim == 2:
        return samples * (first * second)
    return (samples * first[:, :, None]) * second[:, None, :]


def _boxes(box: Box, size: tuple[int, ...]) -> list[Box]:
    axes = [
        [slice(i, min(i + step, side.stop)) for i in range(side.start, side.stop, step)]
        for side, step in zip(box, size, strict=True)
    ]
    return list(product(*axes))


def _part(grid: VoxelGrid, box: Box) -> VoxelGrid:
    return VoxelGrid(grid.x_m[box[2]], grid.y_m[box[1]], grid.z_m[box[0]])


def _corners(grid: VoxelGrid, box: Box) -> np.ndarray:
    """The box's eight corners [3, 8]; distances to an antenna are convex, so they are largest there."""
    part = _part(grid, box)
    ends = [axis[[0, -1]] for axis in (part.x_m, part.y_m, part.z_m)]
    return np.array(list(product(*ends))).T
