"""Volumes by band-limited upsampling: the engine images coarse nodes, and matrix products along x, y and z make every
voxel of them, so that a projection along z never holds the volume.

Between the nodes only the envelope is interpolated: with exp(jk_c Σ R_reference) and the middle of the band taken out,
an image varies as slowly as the array's angles and bandwidth allow.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numba
import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.backprojection import backproject, tone_images
from radar.bands import bands, carriers
from radar.chain import FAST
from radar.engine import Engine
from radar.grid import VoxelGrid
from radar.parallel import for_each
from radar.resample import GUARD, Resampler, resampler
from radar.steering import cis_turns
from radar.tree import Box, Family, crowded

COLUMNS = 1024  # pixels upsampled along z at once: their voxels stay in the second-level cache
ROWS = 16  # pixels along y of one piece of work
UPSAMPLING = 0.6  # its share of the tolerance


class VolumePlan:
    """Imaging of one voxel grid by one aperture at frequencies_hz, to a family's tolerance; with `planes`, of any one
    plane between the grid's first and last z."""

    def __init__(
        self, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, family: Family, planes: bool = False
    ) -> None:
        axes = (grid.x_m, grid.y_m, grid.z_m)
        low_m, high_m = (np.array([axis[i] for axis in axes]) for i in (0, -1))
        low, high = bands(frequencies_hz, aperture, Box(low_m, high_m))
        margin_m = 2 * np.pi * GUARD / np.maximum(high - low, 1.0) * (high_m > low_m)
        low, high = bands(frequencies_hz, aperture, Box(low_m - margin_m, high_m + margin_m))
        self.x, self.y, self.z = (
            Resampler(axis, ()) if planes and axis is grid.z_m else resampler(axis, half, UPSAMPLING * family.tolerance)
            for axis, half in zip(axes, (high - low) / 2, strict=True)
        )
        self.grid = grid
        self.nodes = VoxelGrid(self.x.nodes_m, self.y.nodes_m, self.z.nodes_m)
        nodes = (self.nodes.x_m, self.nodes.y_m, self.nodes.z_m)
        box = Box(*(np.array([axis[i] for axis in nodes]) for i in (0, -1)))
        self._engine = None if crowded(aperture) else Engine(frequencies_hz, aperture, box, family)
        self._planes = planes
        fixed = self._engine is not None and not planes
        self._where = self._engine.sort(self.nodes.points_m().reshape(-1, 3)) if fixed else None
        exact = tone_images if family.apart else backproject
        self._exact = partial(exact, frequencies_hz=frequencies_hz, aperture=aperture)
        middle = (np.min(frequencies_hz) + np.max(frequencies_hz)) / 2 / SPEED_OF_LIGHT_M_S
        passes, reference_m = carriers(aperture)
        self.carrier = middle, passes, reference_m, (low + high) / (4 * np.pi)

    def volumes(self, samples: np.ndarray, z_m: np.ndarray) -> np.ndarray:
        """Complex images [k or 1, nz, ny, nx]; z_m: the grid's, or the depth [1] of a plane."""
        nodes, images = self._nodes(samples, z_m)
        volumes = np.empty((len(images), len(z_m), *self.grid.shape[1:]), np.complex64)
        for image, volume in zip(images, volumes, strict=True):

            def keep(rows: slice, start: int, re: np.ndarray, im: np.ndarray, volume: np.ndarray = volume) -> None:
                _restore(re, im, self.grid.x_m, self.grid.y_m, z_m, rows.start, start, *self.carrier, volume)

            self._upsample(nodes, image, keep)
        return volumes

    def peaks(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `strongest_voxels` of the volume, which is never held."""
        nodes, images = self._nodes(samples, z_m)
        ny, nx = self.grid.shape[1:]
        index = np.empty(ny * nx, np.int64)
        magnitude = np.empty((3, ny * nx), np.float32)

        def keep(rows: slice, start: int, re: np.ndarray, im: np.ndarray) -> None:
            here = slice(rows.start * nx + start, rows.start * nx + start + re.shape[1])
            _strongest(re, im, index[here], magnitude[:, here])

        self._upsample(nodes, images[0], keep)
        return index.reshape(ny, nx), magnitude.reshape(3, ny, nx)

    def _nodes(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[VoxelGrid, np.ndarray]:
        """The coarse nodes and their images [k or 1, nz, ny, nx]."""
        nodes = VoxelGrid(self.nodes.x_m, self.nodes.y_m, z_m) if self._planes else self.nodes
        points_m = nodes.points_m().reshape(-1, 3) if self._where is None else None
        if self._engine is None:
            images = self._exact(samples, points_m=points_m)
        else:
            images = self._engine.image(samples, self._where or self._engine.sort(points_m))
        return nodes, images.reshape(-1, *nodes.shape)

    def _upsample(
        self, nodes: VoxelGrid, image: np.ndarray, keep: Callable[[slice, int, np.ndarray, np.ndarray], None]
    ) -> None:
        """Envelope of all voxels from the nodes' image [nz, ny, nx], handed to keep(rows, start, re, im) in pieces
        [nz, columns] of the rows' pixels from `start` on."""
        nz, ny, _ = nodes.shape
        along_x = np.empty((2, nz, ny, len(self.grid.x_m)), np.float32)

        def widen(z: int) -> None:
            envelope = np.empty((2, *image.shape[1:]), np.float32)
            _take_out(image[z], nodes.x_m, nodes.y_m, nodes.z_m[z], *self.carrier, envelope)
            self.x.apply(envelope, along_x[:, z])

        def heighten(window: tuple[slice, slice, np.ndarray | None]) -> None:
            rows, of, weights = window
            block = along_x[:, :, of] if weights is None else np.matmul(weights, along_x[:, :, of])
            block = block.reshape(2, nz, -1)
            for start in range(0, block.shape[2], COLUMNS):
                re, im = (self.z.along_first(plane[:, start : start + COLUMNS]) for plane in block)
                keep(rows, start, re, im)

        for_each(widen, range(nz))
        for_each(heighten, self.y.rows(ROWS))


def strongest_voxels(volume: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each pixel's strongest voxel of a volume [nz, ny, nx]: index along z [ny, nx], and magnitude [3, ny, nx] of the
    voxel before it, itself and the one behind it (NaN beyond the volume)."""
    nz, ny, nx = volume.shape
    index = np.empty(ny * nx, np.int64)
    magnitude = np.empty((3, ny * nx), np.float32)
    flat = volume.reshape(nz, -1)
    for start in range(0, ny * nx, COLUMNS):
        here = slice(start, start + COLUMNS)
        columns = flat[:, here]
        re, im = np.ascontiguousarray(columns.real), np.ascontiguousarray(columns.imag)
        _strongest(re, im, index[here], magnitude[:, here])
    return index.reshape(ny, nx), magnitude.reshape(3, ny, nx)


@numba.njit(**FAST)
def _carrier_turns(x, y, z, turns_per_m, passes, reference_m, ramp):  # type: ignore[no-untyped-def]
    turns = ramp[0] * x + ramp[1] * y + ramp[2] * z
    for i in range(2):
        dx, dy, dz = x - reference_m[i, 0], y - reference_m[i, 1], z - reference_m[i, 2]
        turns += turns_per_m * passes[i] * np.sqrt(dx * dx + dy * dy + dz * dz)
    return turns


@numba.njit(**FAST)
def _take_out(image, x_m, y_m, z_m, turns_per_m, passes, reference_m, ramp, planes):  # type: ignore[no-untyped-def]
    """planes [2, ny, nx] = image [ny, nx] without its carrier."""
    for j in range(len(y_m)):
        for i in range(len(x_m)):
            cosine, sine = cis_turns(_carrier_turns(x_m[i], y_m[j], z_m, turns_per_m, passes, reference_m, ramp))
            value = image[j, i]
            planes[0, j, i] = value.real * cosine + value.imag * sine
            planes[1, j, i] = value.imag * cosine - value.real * sine


@numba.njit(**FAST)
def _restore(re, im, x_m, y_m, z_m, row, column, turns_per_m, passes, reference_m, ramp, volume):  # type: ignore[no-untyped-def]
    """volume[z, y, x] = (re + j·im)[z, pixel] · carrier, for pixels from `column` on of the rows from `row` on."""
    nx = len(x_m)
    for k in range(len(z_m)):
        for p in range(re.shape[1]):
            j, i = row + (column + p) // nx, (column + p) % nx
            cosine, sine = cis_turns(_carrier_turns(x_m[i], y_m[j], z_m[k], turns_per_m, passes, reference_m, ramp))
            volume[k, j, i] = complex(re[k, p] * cosine - im[k, p] * sine, im[k, p] * cosine + re[k, p] * sine)


@numba.njit(**FAST)
def _strongest(re, im, index, magnitude):  # type: ignore[no-untyped-def]
    nz, n = re.shape
    best = np.full(n, np.float32(-1))
    where = np.zeros(n, np.int32)
    for k in range(nz):
        for p in range(n):
            power = re[k, p] * re[k, p] + im[k, p] * im[k, p]
            larger = power > best[p]
            where[p] = np.int32(k) if larger else where[p]
            best[p] = power if larger else best[p]
    for p in range(n):
        index[p] = where[p]
        magnitude[1, p] = np.sqrt(best[p])
        for side in (0, 2):
            k = where[p] + side - 1
            if 0 <= k < nz:
                magnitude[side, p] = np.sqrt(re[k, p] * re[k, p] + im[k, p] * im[k, p])
            else:
                magnitude[side, p] = np.nan
