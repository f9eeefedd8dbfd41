"""Volumes tile by tile, each with as many tones as it needs (see `radar.tones`)."""

from __future__ import annotations

from itertools import product

import numpy as np

from radar.arrays import Aperture
from radar.backprojection import check_samples, coherent_sum, stack
from radar.grid import VoxelGrid
from radar.parallel import for_each
from radar.progress import track
from radar.tones import ToneSkeleton

SUPERTILE = (96, 72, 72)  # voxels along z, y, x: tones are compressed once for many tiles ...
TILE = (24, 20, 20)  # ... and then again, for each tile from its supertile's few

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
        shared = ToneSkeleton(frequencies_hz, aperture, _corners(grid, super_box), tolerance)
        shared_samples = shared.compress(samples)

        def work(box: Box, shared: ToneSkeleton = shared, samples: np.ndarray = shared_samples) -> None:
            tones = ToneSkeleton(shared.frequencies_hz, aperture, _corners(grid, box), tolerance)
            part = _part(grid, box)
            stacked = [stack(s) for s in tones.compress(samples)]
            image = coherent_sum(stacked, tones.frequencies_hz, aperture, part.points_m().reshape(-1, 3))
            volume[box] = image.reshape(part.shape)

        for_each(work, _boxes(super_box, TILE))
    return volume


def _boxes(box: Box, size: tuple[int, ...]) -> list[Box]:
    axes = [
        [slice(i, min(i + step, side.stop)) for i in range(side.start, side.stop, step)]
        for side, step in zip(box, size, strict=True)
    ]
    return list(product(*axes))


def _part(grid: VoxelGrid, box: Box) -> VoxelGrid:
    return VoxelGrid(grid.x_m[box[2]], grid.y_m[box[1]], grid.z_m[box[0]])


def _corners(grid: VoxelGrid, box: Box) -> np.ndarray:
    """The box's eight corners [3, 8]."""
    part = _part(grid, box)
    ends = [axis[[0, -1]] for axis in (part.x_m, part.y_m, part.z_m)]
    return np.array(list(product(*ends))).T
