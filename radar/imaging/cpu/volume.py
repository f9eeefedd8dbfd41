"""Volumes by band-limited upsampling: the engine images coarse nodes, and matrix products along x, y and z make every
voxel of them, so that a projection along z never holds the volume.

Between the nodes only the envelope is interpolated: with exp(jk_c Σ R_reference) and the middle of the band taken out,
an image varies as slowly as the array's angles and bandwidth allow.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product

import numba
import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.data.grid import VoxelGrid
from radar.imaging.bands import bands, carriers
from radar.imaging.cpu.chain import FAST
from radar.imaging.cpu.engine import Engine, Sorted
from radar.imaging.cpu.exact import backproject, tone_images
from radar.imaging.cpu.steering import cis_turns
from radar.imaging.resample import GUARD, Resampler, resampler
from radar.imaging.tree import Box, Family, crowded
from radar.support.memory import require_memory
from radar.support.parallel import for_each

VOXELS = 1 << 16  # upsampled along z at once: they stay in the second-level cache
ROWS = 16  # pixels along y of one piece of work
NODE_BYTES = 100  # a node's position, order and images
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
        along_x = self.nodes.shape[0] * self.nodes.shape[1] * len(grid.x_m)
        images = len(frequencies_hz) if family.apart else 1
        needed = images * (NODE_BYTES * int(np.prod(self.nodes.shape)) + 8 * along_x)
        require_memory(needed, f"grid of {grid.shape} voxels [nz, ny, nx]")
        self._engine = None if crowded(aperture) else Engine(frequencies_hz, aperture, box, family)
        self._planes = planes
        self._where: Sorted | None = None
        exact = tone_images if family.apart else backproject
        self._exact = partial(exact, frequencies_hz=frequencies_hz, aperture=aperture)
        middle = (np.min(frequencies_hz) + np.max(frequencies_hz)) / 2 / SPEED_OF_LIGHT_M_S
        passes, reference_m = carriers(aperture)
        self.carrier = middle, passes, reference_m, (low + high) / (4 * np.pi)

    def volumes(self, samples: np.ndarray, z_m: np.ndarray, carrier: bool) -> np.ndarray:
        """Complex images [k or 1, nz, ny, nx], with carrier or without; z_m: the grid's, or a plane's depth [1]."""
        nodes, images = self._nodes(samples, z_m)
        volumes = np.empty((len(images), len(z_m), *self.grid.shape[1:]), np.complex64)

        def keep(image: int, rows: slice, re: np.ndarray, im: np.ndarray) -> None:
            if carrier:
                volumes[image, :, rows] = _restore(re, im, self.grid.x_m, self.grid.y_m[rows], z_m, *self.carrier)
            else:
                volumes[image, :, rows].real, volumes[image, :, rows].imag = re, im

        self._upsample(nodes, images, keep)
        return volumes

    def peaks(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `strongest_voxels` of the volume, which is never held."""
        nodes, images = self._nodes(samples, z_m)
        index = np.empty(self.grid.shape[1:], np.int64)
        magnitude = np.empty((3, *index.shape), np.float32)

        def keep(_: int, rows: slice, re: np.ndarray, im: np.ndarray) -> None:
            index[rows], magnitude[:, rows] = _strongest(re, im)

        self._upsample(nodes, images, keep)
        return index, magnitude

    def _nodes(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[VoxelGrid, np.ndarray]:
        """The coarse nodes and their images [k or 1, nz, ny, nx]."""
        nodes = VoxelGrid(self.nodes.x_m, self.nodes.y_m, z_m) if self._planes else self.nodes
        if self._engine is None:
            images = self._exact(samples, points_m=nodes.points_m().reshape(-1, 3))
        else:
            images = self._engine.image(samples, self._sorted(nodes))
        return nodes, images.reshape(-1, *nodes.shape)

    def _sorted(self, nodes: VoxelGrid) -> Sorted:
        """The nodes in the engine's order, which no plane's depth changes as long as the leaves are one layer."""
        if self._planes and self._engine.limbs[2] * self._engine.leaves[2] > 1:
            return self._engine.sort(nodes.points_m().reshape(-1, 3))
        if self._where is None:
            self._where = self._engine.sort(nodes.points_m().reshape(-1, 3))
        if not self._planes:
            return self._where
        points_m = self._where.points_m.copy()
        points_m[2] = nodes.z_m
        return self._where._replace(points_m=points_m)

    def _upsample(
        self, nodes: VoxelGrid, images: np.ndarray, keep: Callable[[int, slice, np.ndarray, np.ndarray], None]
    ) -> None:
        """Envelopes of all voxels from the nodes' images [k, nz, ny, nx], handed to keep(image, rows, re, im) in pieces
        [nz, rows, nx]."""
        count, nz, ny, _ = images.shape
        at_once = max(VOXELS // (len(self.grid.x_m) * (len(self.grid.z_m) if self.z.windows else nz)), 1)
        along_x = np.empty((count, 2, nz, ny, len(self.grid.x_m)), np.float32)

        def widen(part: tuple[int, int, slice]) -> None:
            image, z, rows = part
            piece = images[image, z, rows]
            envelope = np.empty((2, *piece.shape), np.float32)
            _take_out(piece, nodes.x_m, nodes.y_m[rows], nodes.z_m[z], *self.carrier, envelope)
            self.x.apply(envelope, along_x[image, :, z, rows])

        def heighten(part: tuple[int, tuple[slice, slice, np.ndarray | None]]) -> None:
            image, (rows, of, weights) = part
            block = along_x[image, :, :, of] if weights is None else np.matmul(weights, along_x[image, :, :, of])
            for start in range(0, block.shape[2], at_once):
                piece = block[:, :, start : start + at_once]
                re, im = (self.z.along_first(plane.reshape(nz, -1)).reshape(-1, *plane.shape[1:]) for plane in piece)
                keep(image, slice(rows.start + start, rows.start + start + piece.shape[2]), re, im)

        halves = [slice(0, (ny + 1) // 2), slice((ny + 1) // 2, ny)]
        for_each(widen, list(product(range(count), range(nz), halves)))
        for_each(heighten, list(product(range(count), self.y.rows(max(ROWS, at_once)))))


def strongest_voxels(volume: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each pixel's strongest voxel of a volume [nz, ny, nx]: index along z [ny, nx], and magnitude [3, ny, nx] of the
    voxel before it, itself and the one behind it (NaN beyond the volume)."""
    index = np.empty(volume.shape[1:], np.int64)
    magnitude = np.empty((3, *index.shape), np.float32)
    for row in range(len(index)):
        here = slice(row, row + 1)
        re, im = (np.ascontiguousarray(part, np.float32) for part in (volume[:, here].real, volume[:, here].imag))
        index[here], magnitude[:, here] = _strongest(re, im)
    return index, magnitude


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
def _restore(re, im, x_m, y_m, z_m, turns_per_m, passes, reference_m, ramp):  # type: ignore[no-untyped-def]
    """(re + j·im) · carrier: complex64 [nz, ny, nx]."""
    nx = len(x_m)
    volume = np.empty(re.shape, np.complex64)
    cosine, sine = np.empty(nx, np.float32), np.empty(nx, np.float32)
    for k in range(len(z_m)):
        for j in range(len(y_m)):
            for i in range(nx):
                turns = _carrier_turns(x_m[i], y_m[j], z_m[k], turns_per_m, passes, reference_m, ramp)
                cosine[i], sine[i] = cis_turns(turns)
            for i in range(nx):
                value_re, value_im = re[k, j, i], im[k, j, i]
                volume[k, j, i] = complex(
                    value_re * cosine[i] - value_im * sine[i], value_im * cosine[i] + value_re * sine[i]
                )
    return volume


@numba.njit(**FAST)
def _strongest(re, im):  # type: ignore[no-untyped-def]
    nz, ny, nx = re.shape
    index, magnitude = np.empty((ny, nx), np.int64), np.empty((3, ny, nx), np.float32)
    for j in range(ny):
        best = np.full(nx, np.float32(-1))
        where = np.zeros(nx, np.int32)
        for k in range(nz):
            for i in range(nx):
                power = re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i]
                larger = power > best[i]
                where[i] = np.int32(k) if larger else where[i]
                best[i] = power if larger else best[i]
        for i in range(nx):
            index[j, i] = where[i]
            magnitude[1, j, i] = np.sqrt(best[i])
            for side in (0, 2):
                k = where[i] + side - 1
                if 0 <= k < nz:
                    magnitude[side, j, i] = np.sqrt(re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i])
                else:
                    magnitude[side, j, i] = np.nan
    return index, magnitude
