"""Imaging on a device as array code: all boxes of one level of the tree at once, and volumes
interpolated from coarse nodes.

The points of a leaf (a smallest box) are divided into pieces, and pieces of similar size are filled
up to equal size and computed together as a batch, with one product per tone. As in
`radar.imaging.cpu.forward`, path differences to a reference point are computed in float64 and the
remainders in float32. What depends on the plan alone stays on the device.

An exact image is one batch of complex products per block of points, one product per tone. A planar
scan is treated as an array with a single receiver that the path does not pass.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from threading import Lock
from typing import NamedTuple

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture, array_legs
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.device import BLOCK_BYTES, Array, array_module, cis, distances, to_host
from handbench.radar.imaging.gpu.levels import BoxAntennas, Level, box_antennas, level
from handbench.radar.imaging.peaks import Peaks
from handbench.radar.imaging.plan import GridPlan, SortedPoints, TreePlan
from handbench.radar.imaging.skeleton import Resampler
from handbench.radar.imaging.tree import Node
from handbench.support.parallel import for_each

PIECE = 512  # points of one leaf that share a product
KEPT_BYTES = 1 << 31  # of factors that stay on the device between frames
WAVE_BYTES = 24  # per point, tone and antenna: turns, phases and products
PATH_BYTES = 40  # per point and antenna: differences in double
# per point and antenna of an exact image: distances in double, their turns, phases and products
POINT_BYTES = 48
VOXEL_BYTES = 64  # per voxel of a piece: both planes, and their magnitude or carrier


class Batch(NamedTuple):
    """Points that are imaged together on the device: n pieces of up to p points, each piece within
    one leaf (smallest box of the plan).

    sample [n]: row of each piece's leaf among the computed samples; leaf [n]: row of the same leaf
    among all leaves; point [n, p]: index of each point among the sorted points; target [n, p]:
    column of the images to which its value is written. Points that only fill up a piece are
    written to one extra column.
    """

    sample: Array
    leaf: Array
    point: Array
    target: Array


@dataclass(frozen=True)
class DevicePoints:
    """Points copied to the device, grouped by leaf (smallest box of the plan).

    points_m [3, n]; cells, leaves: `Level`s of the cells computed so far and of the leaves that
    contain points; antennas: those of all leaves computed so far; batches: the points to image.
    """

    points_m: Array
    cells: Level
    leaves: Level
    antennas: BoxAntennas
    batches: list[Batch]

    @property
    def wave_bytes(self) -> int:
        """Memory of the factors of all points (`BoxAntennas.waves`)."""
        _, boxes, length = self.antennas.position_m.shape
        tones = self.antennas.turns_per_m.size // boxes
        return 8 * tones * length * sum(batch.point.size for batch in self.batches)

    def waves(self) -> Iterator[tuple[Array, Array]]:
        """Compute the factors of each batch (`BoxAntennas.waves`)."""
        for batch in self.batches:
            yield self.antennas.waves(batch.leaf, self.points_m[:, batch.point])


class _KeptWaves:
    """The factors of the points that were imaged twice in a row last, by whichever plan: a grid's
    are the same for every frame. They stay on the device if they need at most KEPT_BYTES."""

    def __init__(self) -> None:
        self._kept: tuple[DevicePoints | None, list[tuple[Array, Array]]] = None, []

    def of(self, points: DevicePoints, again: bool) -> Iterable[tuple[Array, Array]]:
        """Return the factors of each batch, kept or computed as they are used. again: keep them."""
        of, waves = self._kept
        if of is points:
            return waves
        if not again or points.wave_bytes > KEPT_BYTES:
            return points.waves()
        self._kept = None, []  # frees the memory of the former
        waves = list(points.waves())
        self._kept = points, waves
        return waves


_kept_waves = _KeptWaves()


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
        self._boxes: tuple[Level, Level, BoxAntennas] | None = None
        self._last: tuple[SortedPoints | None, DevicePoints | None] = None, None
        self._lock = Lock()

    def place(self, where: SortedPoints) -> DevicePoints:
        """Copy points that the plan has sorted to the device, and group them into batches. If they
        are the points of the last call, its result is returned again; if they are in the same
        leaves, its groups."""
        last, placed = self._last
        if last is None or placed is None or last.order is not where.order:
            placed = self._grouped(where)
        elif last.points_m is not where.points_m:
            placed = replace(placed, points_m=self._xp.asarray(where.points_m))
        self._last = where, placed
        return placed

    def _grouped(self, where: SortedPoints) -> DevicePoints:
        xp, per_cell = self._xp, self.plan.leaves_per_cell
        touched = np.flatnonzero(np.diff(where.starts))  # leaves, counted over all cells
        cells, leaves, antennas, cell_rows = self._require(np.unique(touched // per_cell))
        rows = cell_rows[touched // per_cell] * per_cell + touched % per_cell
        tones, length = antennas.turns_per_m.shape[1], antennas.length_m.shape[1]
        batches = _batches(where, touched, rows, length * (WAVE_BYTES * tones + PATH_BYTES))
        on_device = [Batch(*map(xp.asarray, batch)) for batch in batches]
        points_m = xp.asarray(where.points_m)
        return DevicePoints(points_m, cells, leaves.of(rows), antennas, on_device)

    def image(self, samples: np.ndarray, where: SortedPoints) -> Array:
        """Image points that the plan has sorted: complex64 [f, points] on the device, one image per
        tone, if the plan keeps tones apart, else [1, points], the sum of all tones. The images are
        in the order before sorting. samples: complex [f, t, r], or [f, n] of a scan."""
        _, before = self._last
        placed = self.place(where)
        whole = samples.reshape(1, len(samples), samples.shape[1], -1)
        waves = _kept_waves.of(placed, again=placed is before)
        return self._images(self._xp.asarray(whole, dtype=np.complex64), placed, waves)

    def _images(
        self, samples: Array, placed: DevicePoints, waves: Iterable[tuple[Array, Array]]
    ) -> Array:
        """Image placed points from samples [1, f, t, r] and the factors of each batch."""
        xp, apart = self._xp, self.plan.family.apart
        leaves = placed.leaves.descend(placed.cells.descend(self._top.descend(samples)))
        count = placed.points_m.shape[1]
        images = xp.empty((samples.shape[1] if apart else 1, count + 1), np.complex64)
        for batch, (wave_a, wave_b) in zip(placed.batches, waves, strict=True):
            received = xp.matmul(leaves[batch.sample].swapaxes(2, 3), wave_a)
            received *= wave_b
            tones = received.sum(axis=2)
            images[:, batch.target] = tones.swapaxes(0, 1) if apart else tones.sum(axis=1)[None]
        return images[:, :-1]

    def _require(self, cells: np.ndarray) -> tuple[Level, Level, BoxAntennas, np.ndarray]:
        """Compute the plan's cells with these numbers, and their leaves, unless they are there
        already: (`Level` of all cells computed so far, `Level` of their leaves and these leaves'
        `BoxAntennas`, row of every cell of the plan in the first `Level`, −1 if it is not
        computed)."""
        with self._lock:
            new = [int(cell) for cell in cells if int(cell) not in self._planned]
            if new or self._boxes is None:
                for_each(self._plan_cell, new)
                nodes = [self._planned[cell] for cell in sorted(self._planned)]
                above = [cell for cell, _ in nodes]
                below = [leaf for _, leaves in nodes for leaf in leaves]
                parent = [row for row, (_, leaves) in enumerate(nodes) for _ in leaves]
                self._boxes = (
                    level(self._xp, above, [self.plan.top_node], [0] * len(above)),
                    level(self._xp, below, above, parent),
                    box_antennas(self._xp, below, self.plan.passes, self.plan.reference_m),
                )
            rows = np.full(self.plan.count, -1)
            rows[sorted(self._planned)] = np.arange(len(self._planned))
            return *self._boxes, rows

    def _plan_cell(self, cell: int) -> None:
        node = self.plan.cell(cell)
        first = cell * self.plan.leaves_per_cell
        leaves = range(first, first + self.plan.leaves_per_cell)
        self._planned[cell] = node, [self.plan.leaf(leaf) for leaf in leaves]


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
        self._removed: Array | None = None

    def volume(self, nodes: VoxelGrid, images: Array, carrier: bool) -> np.ndarray:
        """Interpolate the images [f or 1, nz, ny, nx] at the nodes, on the device, to all voxels:
        complex64 [f or 1, nz, ny, nx]. carrier: False leaves out the image's carrier, a fast phase
        that is the same for all tones."""
        grid, z_m = self.plan.grid, nodes.z_m if self.plan.planes else self.plan.grid.z_m
        volumes = np.empty((len(images), len(z_m), *grid.shape[1:]), np.complex64)
        for image, volume in zip(self._envelopes(nodes, images), volumes, strict=True):
            for rows, voxels in self._upsampled(image):
                if carrier:
                    voxels *= self.plan.carrier_at(
                        VoxelGrid(grid.x_m, grid.y_m[rows], z_m), self._xp
                    )
                volume[:, rows] = to_host(voxels)
        return volumes

    def project(self, nodes: VoxelGrid, images: Array) -> Peaks:
        """Find the strongest voxel along z for each pixel of the volume that the images [1, nz, ny,
        nx] at the nodes, on the device, give by interpolation, without storing the volume."""
        xp = self._xp
        mean_square = float(to_host(_power(images).sum(dtype=np.float64))) / images.size
        peaks = Peaks.empty(
            self.plan.grid.shape[1:], self.plan.tolerance * float(np.sqrt(mean_square))
        )
        for rows, voxels in self._upsampled(self._envelopes(nodes, images)[0]):
            power = _power(voxels)
            found, last = power.argmax(axis=0), len(power) - 1
            around = xp.stack([found - 1, found, found + 1])
            near = xp.sqrt(xp.take_along_axis(power, xp.clip(around, 0, last), axis=0))
            near[(around < 0) | (around > last)] = np.nan
            power[xp.arange(last + 1)[:, None, None] == found] = -1
            rival, second = power.argmax(axis=0), power.max(axis=0)
            none = second < 0
            rival[none] = -1
            second = xp.sqrt(abs(second))
            second[none] = -1
            peaks.index[rows], peaks.rival[rows] = to_host(xp.stack([found, rival]))
            peaks.magnitude[:, rows], peaks.second[rows] = to_host(near), to_host(second)
        return peaks

    def _envelopes(self, nodes: VoxelGrid, images: Array) -> Array:
        """Remove the carrier, the fast phase, from images [f or 1, nz, ny, nx] at the nodes. The
        carrier is computed on the processor, and kept if the nodes are always the same."""
        removed = self._removed
        if removed is None:
            removed = self._xp.asarray(self.plan.carrier_at(nodes).conj())
            self._removed = None if self.plan.planes else removed
        return images * removed

    def _upsampled(self, envelope: Array) -> Iterator[tuple[slice, Array]]:
        """Interpolate an image without its carrier, complex64 [nz, ny, nx], to all voxels, and
        yield the result in pieces: (slice along y, complex64 [nz, rows, nx])."""
        xp = self._xp
        nz, ny, _ = envelope.shape
        parts = xp.stack([envelope.real, envelope.imag]).reshape(2 * nz * ny, -1)
        along_x = self._along(self._along_x, parts.T).T.reshape(2, nz, ny, -1)
        # real and imaginary parts in turn, as in memory: the weights are real
        along_x = xp.ascontiguousarray(along_x.transpose(1, 2, 3, 0)).reshape(nz, ny, -1)
        for rows, of, weights in self._along_y:
            block = along_x[:, of] if weights is None else xp.matmul(weights, along_x[:, of])
            voxels = self._along(self._along_z, block.reshape(nz, -1))
            yield rows, voxels.reshape(-1, *block.shape[1:]).view(np.complex64)

    def _windows(self, resampler: Resampler) -> list[tuple[slice, Array]]:
        """Copy the weights with which an axis is interpolated to the device: for each window (piece
        of the axis) the slice of nodes and the weights [fine, nodes]."""
        return [(of, self._xp.asarray(weights)) for _, of, weights in resampler.windows]

    def _along(self, windows: list[tuple[slice, Array]], nodes: Array) -> Array:
        """Interpolate node values [n, m] along the first axis: [fine, m]. windows: from `_windows`;
        if there are none, the fine samples are the nodes and the values are returned unchanged."""
        if not windows:
            return nodes
        pieces = [self._xp.matmul(weights, nodes[of]) for of, weights in windows]
        return pieces[0] if len(pieces) == 1 else self._xp.concatenate(pieces)


def _power(image: Array) -> Array:
    return image.real**2 + image.imag**2


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
        yield Batch(leaf[now], rows[leaf[now]], np.minimum(index, last), target)


def exact_images(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    apart: bool,
) -> Array:
    """Image points_m [n, 3], in metres, by the sum over every tone and antenna on the current
    device: complex64 [f, n] there, one image per tone, with `apart`; else [1, n], their coherent
    sum."""
    xp = array_module()
    matrices = samples.reshape(*samples.shape[:2], -1).swapaxes(1, 2)  # receivers first
    matrices = xp.asarray(np.ascontiguousarray(matrices), dtype=np.complex64)
    tones, n_b, n_a = matrices.shape
    turns_per_m = np.asarray(frequencies_hz, np.float64) / SPEED_OF_LIGHT_M_S
    turns_per_m = xp.asarray(turns_per_m[:, None, None])
    points = xp.asarray(np.ascontiguousarray(points_m.T, np.float64))[:, None]
    legs = [(leg.passes, xp.asarray(leg.position_m.T)[:, :, None]) for leg in aperture.legs]
    images = xp.empty((tones if apart else 1, len(points_m)), np.complex64)
    block = max(BLOCK_BYTES // (POINT_BYTES * (n_a + n_b) * tones), 1)
    for start in range(0, len(points_m), block):
        here = slice(start, start + block)
        lengths = [passes * distances(xp, points[..., here], at) for passes, at in legs]
        paths_a, paths_b = array_legs(aperture, lengths)
        # a scan's sum over positions is a product
        received = xp.matmul(matrices, cis(xp, turns_per_m * paths_a))
        received *= cis(xp, turns_per_m * paths_b)
        part = received.sum(axis=1)
        images[:, here] = part if apart else part.sum(axis=0)
    return images
