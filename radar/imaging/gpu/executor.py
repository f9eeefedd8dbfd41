"""Imaging on a device as array code: all boxes of one level of the tree at once, and volumes
interpolated from coarse nodes.

The points of a leaf (a smallest box) are divided into pieces, and pieces of similar size are filled
up to equal size and computed together as a batch, with one product per tone. As in
`radar.imaging.cpu.forward`, path differences to a reference point are computed in float64 and the
remainders in float32. The images at the nodes go through the processor's memory, since there are
thirty times fewer nodes than voxels.

An exact image is one complex product per tone and block of points. A planar scan is treated as an
array with a single receiver that the path does not pass.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture, array_legs
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.device import BLOCK_BYTES, Array, array_module, cis, distances, to_host
from handbench.radar.imaging.gpu.levels import Level, level
from handbench.radar.imaging.peaks import Peaks, root_mean_square
from handbench.radar.imaging.plan import GridPlan, SortedPoints, TreePlan
from handbench.radar.imaging.skeleton import Resampler
from handbench.radar.imaging.tree import Node
from handbench.support.parallel import for_each

PIECE = 512  # points of one leaf that share a product
WAVE_BYTES = 24  # per point, tone and antenna: turns, phases and products
PATH_BYTES = 40  # per point and antenna: differences in double
# per point and antenna of an exact image: distances in double, their turns, phases and products
POINT_BYTES = 48
VOXEL_BYTES = 64  # per voxel of a piece: both planes, and their magnitude or carrier


class Batch(NamedTuple):
    """Points that are imaged together on the device: n pieces of up to p points, each piece within
    one leaf (smallest box of the plan).

    sample [n]: row of each piece's leaf among the computed samples; leaf [n]: row of the same leaf
    in the `Level` of all leaves; points_m [3, n, p]; target [n, p]: column of the images to which
    each point's value is written. Points that only fill up a piece are written to one extra column.
    """

    sample: Array
    leaf: Array
    points_m: Array
    target: Array


@dataclass(frozen=True)
class DevicePoints:
    """Points copied to the device, grouped by leaf (smallest box of the plan).

    count: number of points; cells, leaves: `Level`s of the cells and leaves computed so far; rows:
    rows of the leaves that contain points; batches: the points to image.
    """

    count: int
    cells: Level
    leaves: Level
    rows: Array
    batches: list[Batch]


class GpuExecutor:
    """Computes images of points on the current device, by a plan of the geometry (`TreePlan`).

    The plan's boxes are computed when points are in them for the first time, and stay in the
    device's memory.
    """

    def __init__(self, plan: TreePlan) -> None:
        self.plan = plan
        self._xp = array_module()
        self._top = level(self._xp, [plan.top_node], [plan.root_node], [0])
        self._planned: dict[int, tuple[Node, list[Node]]] = {}
        self._levels: tuple[Level, Level] | None = None
        self._last: tuple[SortedPoints | None, DevicePoints | None] = None, None
        self._lock = Lock()

    def place(self, where: SortedPoints) -> DevicePoints:
        """Copy points that the plan has sorted to the device, and group them into batches. If they
        are the points of the last call, its result is returned again."""
        last, placed = self._last
        if placed is None or last is not where:
            per_cell = self.plan.leaves_per_cell
            touched = np.flatnonzero(np.diff(where.starts))  # leaves, counted over all cells
            cells, leaves, cell_rows = self._require(np.unique(touched // per_cell))
            rows = cell_rows[touched // per_cell] * per_cell + touched % per_cell
            antennas = sum(length.shape[1] for length in leaves.length_m)
            point_bytes = antennas * (WAVE_BYTES * leaves.turns_per_m.shape[1] + PATH_BYTES)
            batches = _batches(where, touched, rows, point_bytes)
            on_device = [Batch(*map(self._xp.asarray, batch)) for batch in batches]
            placed = DevicePoints(
                len(where.order), cells, leaves, self._xp.asarray(rows), on_device
            )
            self._last = where, placed
        return placed

    def image(self, samples: np.ndarray, where: SortedPoints) -> np.ndarray:
        """Image points that the plan has sorted: complex64 [f, points], one image per tone, if the
        plan keeps tones apart, else [1, points], the sum of all tones. The images are in the order
        before sorting. samples: complex [f, t, r], or [f, n] of a scan."""
        xp, apart, placed = self._xp, self.plan.family.apart, self.place(where)
        whole = xp.asarray(
            samples.reshape(1, len(samples), samples.shape[1], -1), dtype=np.complex64
        )
        root = self._top.descend(whole, xp.arange(1))
        cells = placed.cells.descend(root, xp.arange(placed.cells.centre_m.shape[1]))
        leaves = placed.leaves.descend(cells, placed.rows)
        images = xp.empty((len(samples) if apart else 1, placed.count + 1), np.complex64)
        for batch in placed.batches:
            tones = self._evaluate(placed.leaves, leaves, batch)
            images[:, batch.target] = tones.swapaxes(0, 1) if apart else tones.sum(axis=1)[None]
        return to_host(images[:, :-1])

    def _evaluate(self, leaves: Level, samples: Array, batch: Batch) -> Array:
        """Image the points of a batch at every tone: complex64 [n, k, p], on the device, for n
        pieces of p points. samples: those of the leaves, [leaves, k, a, b]."""
        xp, plan = self._xp, self.plan
        turns = leaves.turns_per_m[batch.leaf][:, :, None]
        waves: list[Array] = []
        common_m: Array = 0.0
        for leg, (passes, reference_m) in enumerate(
            zip(plan.passes, plan.reference_m, strict=True)
        ):
            reference = xp.asarray(reference_m)[:, None]
            centre = distances(xp, leaves.centre_m[:, batch.leaf], reference)[:, None]
            shared_m = passes * (distances(xp, batch.points_m, reference[:, :, None]) - centre)
            antennas = leaves.position_m[leg][:, batch.leaf][:, :, :, None]
            path_m = passes * distances(xp, batch.points_m[:, :, None], antennas)
            path_m -= leaves.length_m[leg][batch.leaf][:, :, None]
            path_m -= shared_m[:, None]
            waves.append(
                cis(xp, turns.astype(np.float32)[..., None] * path_m.astype(np.float32)[:, None])
            )
            common_m = common_m + shared_m
        received = xp.matmul(samples[batch.sample].swapaxes(2, 3), waves[0])
        received *= waves[1]
        return received.sum(axis=2) * cis(xp, turns * common_m[:, None])

    def _require(self, cells: np.ndarray) -> tuple[Level, Level, np.ndarray]:
        """Compute the plan's cells with these numbers, and their leaves, unless they are there
        already: (`Level` of all cells computed so far, `Level` of their leaves, row of every cell
        of the plan in the first `Level`, −1 if it is not computed)."""
        with self._lock:
            new = [int(cell) for cell in cells if int(cell) not in self._planned]
            if new or self._levels is None:
                for_each(self._plan_cell, new)
                nodes = [self._planned[cell] for cell in sorted(self._planned)]
                above = [cell for cell, _ in nodes]
                below = [leaf for _, leaves in nodes for leaf in leaves]
                parent = [row for row, (_, leaves) in enumerate(nodes) for _ in leaves]
                self._levels = (
                    level(self._xp, above, [self.plan.top_node], [0] * len(above)),
                    level(self._xp, below, above, parent),
                )
            rows = np.full(self.plan.count, -1)
            rows[sorted(self._planned)] = np.arange(len(self._planned))
            return *self._levels, rows

    def _plan_cell(self, cell: int) -> None:
        node = self.plan.cell(cell)
        leaves = self.plan.leaves_of(node, range(self.plan.leaves_per_cell))
        self._planned[cell] = node, list(leaves.values())


class GpuUpsampler:
    """Interpolates images from the coarse nodes of a plan, complex [f or 1, nz, ny, nx], to all
    voxels of its grid on the current device: as volumes, or only the strongest voxel along z of
    each pixel."""

    def __init__(self, plan: GridPlan) -> None:
        self.plan, self._xp = plan, array_module()
        self._along_x, self._along_z = self._windows(plan.x), self._windows(plan.z)
        rows = max(BLOCK_BYTES // (VOXEL_BYTES * len(plan.grid.z_m) * len(plan.grid.x_m)), 1)
        self._along_y = [
            (fine, of, None if weights is None else self._xp.asarray(weights))
            for fine, of, weights in plan.y.rows(rows)
        ]

    def volume(self, nodes: VoxelGrid, images: np.ndarray, carrier: bool) -> np.ndarray:
        """Interpolate the images [f or 1, nz, ny, nx] at the nodes to all voxels: complex64 [f or
        1, nz, ny, nx]. carrier: False leaves out the image's carrier, a fast phase that is the same
        for all tones."""
        grid, z_m = self.plan.grid, nodes.z_m if self.plan.planes else self.plan.grid.z_m
        volumes = np.empty((len(images), len(z_m), *grid.shape[1:]), np.complex64)
        for image, volume in zip(images, volumes, strict=True):
            for rows, envelope in self._upsampled(nodes, image):
                voxels = envelope[0] + np.complex64(1j) * envelope[1]
                if carrier:
                    voxels *= self.plan.carrier_at(
                        VoxelGrid(grid.x_m, grid.y_m[rows], z_m), self._xp
                    )
                volume[:, rows] = to_host(voxels)
        return volumes

    def project(self, nodes: VoxelGrid, images: np.ndarray) -> Peaks:
        """Find the strongest voxel along z for each pixel of the volume that the images [1, nz, ny,
        nx] at the nodes give by interpolation, without storing the volume."""
        xp, peaks = (
            self._xp,
            Peaks.empty(self.plan.grid.shape[1:], self.plan.tolerance * root_mean_square(images)),
        )
        for rows, envelope in self._upsampled(nodes, images[0]):
            power = envelope[0] ** 2 + envelope[1] ** 2
            found, last = power.argmax(axis=0), len(power) - 1
            around = xp.stack([found - 1, found, found + 1])
            near = xp.sqrt(xp.take_along_axis(power, xp.clip(around, 0, last), axis=0))
            near[(around < 0) | (around > last)] = np.nan
            peaks.index[rows], peaks.magnitude[:, rows] = to_host(found), to_host(near)
            power[xp.arange(last + 1)[:, None, None] == found] = -1
            second = to_host(power.max(axis=0))
            peaks.rival[rows] = np.where(second < 0, -1, to_host(power.argmax(axis=0)))
            peaks.second[rows] = np.where(second < 0, -1, np.sqrt(np.abs(second)))
        return peaks

    def _upsampled(self, nodes: VoxelGrid, image: np.ndarray) -> Iterator[tuple[slice, Array]]:
        """Interpolate the image [nz, ny, nx] at the nodes to all voxels, without its carrier, and
        yield the result in pieces: (slice along y, float32 [2, nz, rows, nx] with real and
        imaginary part)."""
        xp = self._xp
        envelope = xp.asarray(image) * self.plan.carrier_at(nodes, xp).conj()
        nz, ny, _ = nodes.shape
        planes = xp.stack([envelope.real, envelope.imag]).reshape(2 * nz * ny, -1)
        along_x = self._along(self._along_x, planes.T).T.reshape(2, nz, ny, -1)
        for rows, of, weights in self._along_y:
            block = along_x[:, :, of] if weights is None else xp.matmul(weights, along_x[:, :, of])
            voxels = self._along(self._along_z, block.reshape(2, nz, -1))
            yield rows, voxels.reshape(2, voxels.shape[1], *block.shape[2:])

    def _windows(self, resampler: Resampler) -> list[tuple[slice, Array]]:
        """Copy the weights with which an axis is interpolated to the device: for each window (piece
        of the axis) the slice of nodes and the weights [fine, nodes]."""
        return [(of, self._xp.asarray(weights)) for _, of, weights in resampler.windows]

    def _along(self, windows: list[tuple[slice, Array]], nodes: Array) -> Array:
        """Interpolate node values [..., n, m] along the last axis but one: [..., fine, m]. windows:
        from `_windows`; if there are none, the fine samples are the nodes and the values are
        returned unchanged."""
        if not windows:
            return nodes
        return self._xp.concatenate(
            [self._xp.matmul(weights, nodes[..., of, :]) for of, weights in windows], axis=-2
        )


def _batches(
    where: SortedPoints, touched: np.ndarray, rows: np.ndarray, point_bytes: int
) -> Iterator[Batch]:
    """Group the points of leaves into batches of pieces, as numpy arrays, the largest pieces first.
    The pieces of a batch have similar sizes, so that few copies of a piece's last point are needed
    to fill them up to equal size.

    touched [leaves]: numbers of the leaves that contain points; rows [leaves]: rows of these leaves
    in the `Level` of all leaves; point_bytes: memory needed per point, which limits the size of a
    batch.
    """
    starts, counts = where.starts[touched], np.diff(where.starts)[touched]
    pieces = -(-counts // PIECE)
    leaf = np.repeat(np.arange(len(touched)), pieces)
    # among the pieces of its leaf
    place = np.arange(len(leaf)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first, end = (starts[leaf] + counts[leaf] * (place + i) // pieces[leaf] for i in (0, 1))
    order = np.argsort(first - end, kind="stable")
    while len(order):
        widest = end[order[0]] - first[order[0]]
        now, order = np.split(order, [max(BLOCK_BYTES // int(point_bytes * widest), 1)])
        index, last = first[now, None] + np.arange(widest), end[now, None] - 1
        target = np.where(index <= last, where.order[np.minimum(index, last)], len(where.order))
        yield Batch(leaf[now], rows[leaf[now]], where.points_m[:, np.minimum(index, last)], target)


def exact_images(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    apart: bool,
) -> np.ndarray:
    """Image points_m [n, 3], in metres, by the sum over every tone and antenna on the current
    device: complex64 [f, n], one image per tone, with `apart`; else [1, n], their coherent sum."""
    xp = array_module()
    turns_per_m = np.asarray(frequencies_hz, np.float64) / SPEED_OF_LIGHT_M_S
    matrices = samples.reshape(*samples.shape[:2], -1).swapaxes(1, 2)  # receivers first
    matrices, (n_b, n_a) = xp.asarray(matrices, dtype=np.complex64), matrices.shape[1:]
    images = np.empty((len(samples) if apart else 1, len(points_m)), np.complex64)
    block = max(BLOCK_BYTES // (POINT_BYTES * (n_a + n_b)), 1)
    for start in range(0, len(points_m), block):
        here = slice(start, start + block)
        points = xp.asarray(np.ascontiguousarray(points_m[here].T, np.float64))[:, None]
        lengths = [
            leg.passes * distances(xp, points, xp.asarray(leg.position_m.T)[:, :, None])
            for leg in aperture.legs
        ]
        paths_a, paths_b = array_legs(aperture, lengths)
        part = xp.zeros((len(images), points.shape[2]), np.complex64)
        for f, turns in enumerate(turns_per_m):
            # a scan's sum over positions is a product
            received = xp.matmul(matrices[f], cis(xp, turns * paths_a))
            received *= cis(xp, turns * paths_b)
            part[f if apart else 0] += received.sum(axis=0)
        images[:, here] = to_host(part)
    return images
