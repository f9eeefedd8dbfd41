"""Volumes on a device: the nodes, windows and carrier of `radar.imaging.cpu.volume`, with the upsampling as array code.

The nodes' images pass through the processor's memory: there are thirty times fewer of them than voxels.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from radar.data.arrays import Aperture
from radar.data.grid import VoxelGrid
from radar.imaging.cpu.volume import VolumePlan
from radar.imaging.device import BLOCK_BYTES, Array, array_module, to_host
from radar.imaging.gpu.engine import DeviceEngine, Placed
from radar.imaging.gpu.exact import backproject, tone_images
from radar.imaging.gpu.steering import cis, distances
from radar.imaging.resample import Resampler
from radar.imaging.tree import Box, Family, crowded

VOXEL_BYTES = 64  # of a piece: both planes, and what their magnitude or carrier takes


class DeviceVolumePlan:
    """As `radar.imaging.cpu.volume.VolumePlan`, on the chosen device."""

    def __init__(
        self, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, family: Family, planes: bool = False
    ) -> None:
        self._xp, self._planes = array_module(), planes
        self._plan = VolumePlan(frequencies_hz, aperture, grid, family, planes)  # axes and carrier; it images nothing
        exact = tone_images if family.apart else backproject
        self._exact = partial(exact, frequencies_hz=frequencies_hz, aperture=aperture)
        nodes = self._plan.nodes
        box = Box(*(np.array([axis[i] for axis in (nodes.x_m, nodes.y_m, nodes.z_m)]) for i in (0, -1)))
        self._engine = None if crowded(aperture) else DeviceEngine(frequencies_hz, aperture, box, family)
        self._placed = None if planes else self._place(nodes)
        self._along_x, self._along_z = self._windows(self._plan.x), self._windows(self._plan.z)
        rows = max(BLOCK_BYTES // (VOXEL_BYTES * len(grid.z_m) * len(grid.x_m)), 1)
        self._along_y = [
            (fine, of, None if weights is None else self._xp.asarray(weights))
            for fine, of, weights in self._plan.y.rows(rows)
        ]

    def volumes(self, samples: np.ndarray, z_m: np.ndarray, carrier: bool) -> np.ndarray:
        """Complex images [k or 1, nz, ny, nx], with or without carrier; z_m: the grid's, or a plane's depth [1]."""
        grid = self._plan.grid
        nodes, images = self._nodes(samples, z_m)
        volumes = np.empty((len(images), len(z_m), *grid.shape[1:]), np.complex64)
        for image, volume in zip(images, volumes, strict=True):
            for rows, envelope in self._upsampled(nodes, image):
                voxels = envelope[0] + np.complex64(1j) * envelope[1]
                if carrier:
                    voxels *= self._carrier(VoxelGrid(grid.x_m, grid.y_m[rows], z_m))
                volume[:, rows] = to_host(voxels)
        return volumes

    def peaks(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `radar.imaging.cpu.volume.strongest_voxels` of the volume, which is never held."""
        nodes, images = self._nodes(samples, z_m)
        index = np.empty(self._plan.grid.shape[1:], np.int64)
        magnitude = np.empty((3, *index.shape), np.float32)
        for rows, envelope in self._upsampled(nodes, images[0]):
            index[rows], magnitude[:, rows] = self._strongest(envelope[0] ** 2 + envelope[1] ** 2)
        return index, magnitude

    def _nodes(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[VoxelGrid, np.ndarray]:
        """The coarse nodes and their images [k or 1, nz, ny, nx]."""
        nodes = VoxelGrid(self._plan.nodes.x_m, self._plan.nodes.y_m, z_m) if self._planes else self._plan.nodes
        if self._engine is None:
            images = self._exact(samples, points_m=nodes.points_m().reshape(-1, 3))
        else:
            images = self._engine.image(samples, self._placed or self._place(nodes))
        return nodes, images.reshape(-1, *nodes.shape)

    def _place(self, nodes: VoxelGrid) -> Placed | None:
        return None if self._engine is None else self._engine.sort(nodes.points_m().reshape(-1, 3))

    def _upsampled(self, nodes: VoxelGrid, image: np.ndarray) -> Iterator[tuple[slice, Array]]:
        """Envelopes of all voxels from the nodes' image [nz, ny, nx]: (rows, float32 planes [2, nz, rows, nx])."""
        xp = self._xp
        envelope = xp.asarray(image) * self._carrier(nodes).conj()
        nz, ny, _ = nodes.shape
        planes = xp.stack([envelope.real, envelope.imag]).reshape(2 * nz * ny, -1)
        along_x = self._along(self._along_x, planes.T).T.reshape(2, nz, ny, -1)
        for rows, of, weights in self._along_y:
            block = along_x[:, :, of] if weights is None else xp.matmul(weights, along_x[:, :, of])
            voxels = self._along(self._along_z, block.reshape(2, nz, -1))
            yield rows, voxels.reshape(2, voxels.shape[1], *block.shape[2:])

    def _windows(self, resampler: Resampler) -> list[tuple[slice, Array]]:
        """(node slice, weights [fine, nodes]) of every window, on the device."""
        return [(of, self._xp.asarray(weights)) for _, of, weights in resampler.windows]

    def _along(self, windows: list[tuple[slice, Array]], nodes: Array) -> Array:
        """Node values [..., n, m] → fine values [..., fine, m]; without windows the nodes are the fine samples."""
        if not windows:
            return nodes
        return self._xp.concatenate([self._xp.matmul(weights, nodes[..., of, :]) for of, weights in windows], axis=-2)

    def _carrier(self, grid: VoxelGrid) -> Array:
        """What the plan takes out of an image and puts back: complex64 [nz, ny, nx]."""
        xp = self._xp
        turns_per_m, passes, reference_m, ramp = self._plan.carrier
        z, y, x = (xp.asarray(axis) for axis in (grid.z_m[:, None, None], grid.y_m[:, None], grid.x_m))
        turns = ramp[0] * x + ramp[1] * y + ramp[2] * z
        for count, reference in zip(passes, reference_m, strict=True):
            turns += turns_per_m * count * distances(xp, (x, y, z), reference)
        return cis(xp, turns)

    def _strongest(self, power: Array) -> tuple[np.ndarray, np.ndarray]:
        """Index of the maximum along z [ny, nx], and magnitudes [3, ny, nx] before, at and behind it, of power
        [nz, ny, nx]."""
        xp, last = self._xp, len(power) - 1
        index = power.argmax(axis=0)
        around = xp.stack([index - 1, index, index + 1])
        magnitude = xp.sqrt(xp.take_along_axis(power, xp.clip(around, 0, last), axis=0))
        magnitude[(around < 0) | (around > last)] = np.nan
        return to_host(index), to_host(magnitude)
