"""Imaging on a device as array code: all boxes of one level of the tree at once, and volumes
interpolated from coarse nodes.

The points of a leaf (a smallest box) are divided into pieces, and pieces of similar size are filled
up to equal size and computed together as a batch, with one product per tone. As in
`radar.imaging.boxes`, path differences to a reference point are computed in float64 and the
remainders in float32. What depends on the plan and the points alone stays on the device.

An exact image is one batch of complex products per block of points, one product per tone. A planar
scan is treated as an array with a single receiver that the path does not pass.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from types import ModuleType
from weakref import WeakKeyDictionary

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture, array_legs
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.device import (
    BLOCK_BYTES,
    Array,
    array_module,
    cis,
    distances,
    strongest_voxels,
    to_host,
)
from handbench.radar.imaging.plan import GridPlan, SortedPoints, TreePlan
from handbench.radar.imaging.tree import NodeStack, stack
from handbench.support.parallel import for_each

PIECE = 512  # points of one leaf that share a product
KEPT_BYTES = 1 << 30  # of factors that stay on the device between frames
CHILD_BYTES = 32  # per sample of a parent box: it is copied, turned and mixed
WAVE_BYTES = 24  # per point, tone and antenna: turns, phases and products
PATH_BYTES = 40  # per point and antenna: differences in double
# per point and antenna of an exact image: distances in double, their turns, phases and products
POINT_BYTES = 48
VOXEL_BYTES = 64  # per voxel of a piece: both planes, and their magnitude or carrier


@dataclass(frozen=True, eq=False)
class DevicePoints:
    """Points that a plan has sorted, and the plan's boxes that contain them, on the device.

    points_m [3, n]; levels: functions that compute the samples of the whole box, of its cells and
    of their leaves, each from those of the level above; turns_per_m, legs: the leaves' tones [n, k]
    and antennas (`_leaf_legs`); batches: the points to image (`_batches`).
    """

    xp: ModuleType
    points_m: Array
    levels: list[Callable[[Array], Array]]
    turns_per_m: Array
    legs: list[tuple[float, Array, Array]]
    batches: list[tuple[Array, Array, Array]]

    @property
    def wave_bytes(self) -> int:
        """Memory of the factors of all points (`waves`)."""
        tones = self.turns_per_m.shape[1]
        length = sum(length_m.shape[1] for *_, length_m in self.legs)
        return 8 * tones * length * sum(point.size for _, point, _ in self.batches)

    def waves(self) -> Iterator[tuple[Array, Array]]:
        """Compute the factors of each batch (`_waves`)."""
        for leaf, point, _ in self.batches:
            yield _waves(self.xp, self.turns_per_m, self.legs, leaf, self.points_m[:, point])


@lru_cache(maxsize=1)
def _kept_waves(points: DevicePoints) -> list[tuple[Array, Array]]:
    """Compute the factors of the points that were imaged last: a grid's are the same for every
    frame."""
    return list(points.waves())


_last: WeakKeyDictionary[TreePlan, tuple[SortedPoints, DevicePoints]] = WeakKeyDictionary()


def _placed(plan: TreePlan, where: SortedPoints) -> DevicePoints:
    """Copy points that the plan has sorted to the device, and group them into batches. If they are
    the plan's last points on the same device, the result is returned again; if they are in the
    same leaves, its groups."""
    last, placed = _last.get(plan, (None, None))
    if (
        last is None
        or placed is None
        or placed.xp is not array_module()
        or not _same_groups(last, where)
    ):
        placed = _grouped(plan, where)
    elif last.points_m is not where.points_m:
        placed = replace(placed, points_m=placed.xp.asarray(where.points_m))
    _last[plan] = where, placed
    return placed


def _same_groups(first: SortedPoints, second: SortedPoints) -> bool:
    names = ("order", "leaf", "starts")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)


def _grouped(plan: TreePlan, where: SortedPoints) -> DevicePoints:
    xp, groups = array_module(), plan.touched(where)

    def work(group: slice) -> None:
        for leaf in where.leaf[group].tolist():
            plan.leaf(leaf)

    for_each(work, list(groups.values()))
    top = stack([plan.top_node])
    cells = stack([plan.cell(cell) for cell in groups])
    leaves = stack([plan.leaf(leaf) for leaf in where.leaf.tolist()])
    parent = np.repeat(np.arange(len(groups)), [g.stop - g.start for g in groups.values()])
    levels = [
        _level(xp, top, plan.root_node.turns_per_m[None], np.zeros(1, int)),
        _level(xp, cells, top.turns_per_m, np.zeros(len(groups), int)),
        _level(xp, leaves, cells.turns_per_m, parent),
    ]
    turns_per_m, legs = xp.asarray(leaves.turns_per_m), _leaf_legs(xp, leaves, plan)
    length = sum(length_m.shape[1] for *_, length_m in legs)
    point_bytes = length * (WAVE_BYTES * turns_per_m.shape[1] + PATH_BYTES)
    batches = [
        (xp.asarray(leaf), xp.asarray(point), xp.asarray(target))
        for leaf, point, target in _batches(where, point_bytes)
    ]
    return DevicePoints(xp, xp.asarray(where.points_m), levels, turns_per_m, legs, batches)


def image(plan: TreePlan, samples: np.ndarray, where: SortedPoints) -> Array:
    """Image points that the plan has sorted: complex64 [f, points] on the device, one image per
    tone, if the plan keeps all tones, else [1, points], the sum of all tones. The images are in
    the order before sorting. samples: complex [f, t, r], or [f, n] of a scan."""
    placed, per_tone = _placed(plan, where), plan.family.per_tone
    xp, count = placed.xp, placed.points_m.shape[1]
    whole = samples.reshape(1, len(samples), samples.shape[1], -1)
    below = xp.asarray(whole, dtype=np.complex64)
    for descend in placed.levels:
        below = descend(below)
    images = xp.empty((len(samples) if per_tone else 1, count + 1), np.complex64)
    kept = placed.wave_bytes <= KEPT_BYTES
    of_batches = _kept_waves(placed) if kept else placed.waves()
    for (leaf, _, target), (wave_a, wave_b) in zip(placed.batches, of_batches, strict=True):
        received = xp.matmul(below[leaf].swapaxes(2, 3), wave_a)
        received *= wave_b
        tones = received.sum(axis=2)
        images[:, target] = tones.swapaxes(0, 1) if per_tone else tones.sum(axis=1)[None]
    return images[:, :-1]


def _level(
    xp: ModuleType, nodes: NodeStack, turns_per_m: np.ndarray, parent: np.ndarray
) -> Callable[[Array], Array]:
    """Copy the n nodes of one level of the tree to a device with the array module xp, and return
    the function that computes their samples, complex64 [n, k, a, b], from the samples S of all
    boxes of the level above, [n', k', a', b']: L (S e^{jφ}) on the tones, X S Yᵀ on the antennas.

    turns_per_m [n', k']: f/c of the tones of the level above; parent [n]: index of each node's
    parent there. The phases φ move the reference from the parent's centre to the box's.
    """
    turns, parent = xp.asarray(turns_per_m[parent][:, :, None]), xp.asarray(parent)
    (a, shift_a, _, _), (b, shift_b, _, _) = nodes.legs
    to, back = (cis(xp, turns * xp.asarray(shift_m[:, None])) for shift_m in (shift_a, shift_b))
    host = (nodes.tone_weights, a[:, None], np.ascontiguousarray(b.swapaxes(1, 2)))
    of_tones, of_a, of_b = (xp.asarray(weights, dtype=np.complex64) for weights in host)

    def descend(samples: Array) -> Array:
        block = max(BLOCK_BYTES // (CHILD_BYTES * int(np.prod(samples.shape[1:]))), 1)
        parts = []
        for start in range(0, len(parent), block):
            here = slice(start, start + block)
            turned = samples[parent[here]]
            turned *= to[here, :, :, None]
            turned *= back[here, :, None]
            n, k, a, b = turned.shape
            if of_tones.size:
                turned = xp.matmul(of_tones[here], turned.reshape(n, k, -1))
            if of_b.size:
                turned = xp.matmul(turned.reshape(n, -1, b), of_b[here])
            turned = turned.reshape(n, of_tones.shape[1] or k, a, -1)
            parts.append(xp.matmul(of_a[here], turned) if of_a.size else turned)
        return xp.concatenate(parts)

    return descend


def _leaf_legs(
    xp: ModuleType, leaves: NodeStack, plan: TreePlan
) -> list[tuple[float, Array, Array]]:
    """Copy the antennas of n leaves of the plan to a device, float64: for transmitters and for
    receivers, how often a path passes them, positions [3, n, l] and paths to the leaf's centre
    [n, l]. The last of the l antennas is a reference point, the mean position of all antennas of
    that leg."""
    legs = []
    passes_of = plan.passes.tolist()
    for leg, passes, reference_m in zip(leaves.legs, passes_of, plan.reference_m, strict=True):
        _, _, length_m, position_m = leg
        references_m = np.broadcast_to(reference_m, (len(length_m), 1, 3))
        to_reference_m = passes * distances(np, leaves.centre_m.T, reference_m)
        position_m = np.concatenate([position_m, references_m], axis=1)
        length_m = np.concatenate([length_m, to_reference_m[:, None]], axis=1)
        position_m = np.moveaxis(position_m, 2, 0).copy()
        legs.append((passes, xp.asarray(position_m), xp.asarray(length_m)))
    return legs


def _waves(
    xp: ModuleType,
    turns_per_m: Array,
    legs: list[tuple[float, Array, Array]],
    leaves: Array,
    points_m: Array,
) -> tuple[Array, Array]:
    """Compute the waves e^{jkΔR} of the antennas of leaves [m] at p points of each, points_m [3, m,
    p]: complex64 [m, k, a, p] and [m, k, b, p]. turns_per_m [n, k]: f/c of the tones of all leaves;
    legs: their antennas (`_leaf_legs`).

    Path differences to the reference point are computed in float64, and the phases of these
    remainders in float32; the second factor has the reference's own phase.
    """
    turns_per_m = turns_per_m[leaves][:, :, None]
    shared_m, factors = 0.0, []
    for passes, position_m, length_m in legs:
        path_m = distances(xp, points_m[:, :, None], position_m[:, leaves][..., None])
        path_m *= passes
        path_m -= length_m[leaves][..., None]
        reference_m = path_m[:, -1:]
        shared_m = shared_m + reference_m
        remainder_m = (path_m[:, :-1] - reference_m).astype(np.float32)
        factors.append(cis(xp, turns_per_m[..., None].astype(np.float32) * remainder_m[:, None]))
    return factors[0], factors[1] * cis(xp, turns_per_m * shared_m)[:, :, None]


def volume(plan: GridPlan, nodes: VoxelGrid, images: Array, carrier: bool) -> np.ndarray:
    """Interpolate images [f or 1, nz, ny, nx] at the nodes, on the device, to all voxels of the
    plan's grid: complex64 [f or 1, nz, ny, nx]. carrier: False leaves out the image's carrier, a
    fast phase that is the same for all tones."""
    grid, z_m = plan.grid, nodes.z_m if plan.planes else plan.grid.z_m
    volumes = np.empty((len(images), len(z_m), *grid.shape[1:]), np.complex64)
    for of_nodes, of_grid in zip(images, volumes, strict=True):
        for rows, voxels in _upsampled(plan, nodes, of_nodes):
            if carrier:
                here = VoxelGrid(grid.x_m, grid.y_m[rows], z_m)
                voxels *= plan.carrier_at(here, array_module())
            of_grid[:, rows] = to_host(voxels)
    return volumes


def project(plan: GridPlan, nodes: VoxelGrid, images: Array) -> tuple[np.ndarray, np.ndarray]:
    """Find the strongest voxel along z for each pixel of the volume that the images [1, nz, ny, nx]
    at the nodes, on the device, give by interpolation, without storing the volume: (index,
    magnitude) as of `strongest_voxels`, on the host."""
    parts = [
        [to_host(part) for part in strongest_voxels(voxels.real, voxels.imag, array_module())]
        for _, voxels in _upsampled(plan, nodes, images[0])
    ]
    index, magnitude = zip(*parts, strict=True)
    return np.concatenate(index), np.concatenate(magnitude, axis=1)


def _upsampled(plan: GridPlan, nodes: VoxelGrid, image: Array) -> Iterator[tuple[slice, Array]]:
    """Interpolate an image [nz, ny, nx] at the nodes to all voxels, without its carrier, and yield
    the result in pieces: (slice along y, complex64 [nz, rows, nx])."""
    xp = array_module()
    of_x, of_y, of_z = map(xp.asarray, plan.weights)
    envelope = image * plan.carrier_at(nodes, xp).conj()
    along_x = xp.matmul(xp.stack([envelope.real, envelope.imag]), of_x.T)
    # real and imaginary parts in turn, as in memory: the weights are real
    along_x = xp.ascontiguousarray(along_x.transpose(1, 2, 3, 0))
    along_x = along_x.reshape(*envelope.shape[:2], -1)
    most = max(BLOCK_BYTES // (VOXEL_BYTES * len(of_z) * len(of_x)), 1)
    for first in range(0, len(of_y), most):
        block = xp.matmul(of_y[first : first + most], along_x)
        voxels = xp.matmul(of_z, block.reshape(len(block), -1))
        rows = slice(first, first + block.shape[1])
        yield rows, voxels.reshape(-1, *block.shape[1:]).view(np.complex64)


def _batches(
    where: SortedPoints, point_bytes: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Group the points of leaves into batches of n pieces of up to p points, the largest pieces
    first: (row of each piece's leaf [n], index of each point among the sorted points [n, p], column
    of the images to which its value is written [n, p]).

    The pieces of a batch have similar sizes, so that few copies of a piece's last point are needed
    to fill them up to equal size; these are written to one extra column. point_bytes: memory needed
    per point, which limits the size of a batch.
    """
    starts, order, counts = where.starts, where.order, np.diff(where.starts)
    pieces = -(-counts // PIECE)
    leaf = np.repeat(np.arange(len(counts)), pieces)
    # among the pieces of its leaf
    place = np.arange(len(leaf)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first, end = (starts[leaf] + counts[leaf] * (place + i) // pieces[leaf] for i in (0, 1))
    largest_first = np.argsort(first - end, kind="stable")
    while len(largest_first):
        widest = end[largest_first[0]] - first[largest_first[0]]
        most = max(BLOCK_BYTES // int(point_bytes * widest), 1)
        now, largest_first = np.split(largest_first, [most])
        index, last = first[now, None] + np.arange(widest), end[now, None] - 1
        target = np.where(index <= last, order[np.minimum(index, last)], len(order))
        yield leaf[now], np.minimum(index, last), target


def exact_images(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    per_tone: bool,
) -> Array:
    """Image points_m [n, 3], in metres, by the sum over every tone and antenna on the current
    device: complex64 [f, n] there, one image per tone, with `per_tone`; else [1, n], their coherent
    sum."""
    xp = array_module()
    matrices = samples.reshape(*samples.shape[:2], -1).swapaxes(1, 2)  # receivers first
    matrices = xp.asarray(np.ascontiguousarray(matrices), dtype=np.complex64)
    tones, n_b, n_a = matrices.shape
    turns_per_m = np.asarray(frequencies_hz, np.float64) / SPEED_OF_LIGHT_M_S
    turns_per_m = xp.asarray(turns_per_m[:, None, None])
    points = xp.asarray(np.ascontiguousarray(points_m.T, np.float64))[:, None]
    legs = [(leg.passes, xp.asarray(leg.position_m.T)[:, :, None]) for leg in aperture.legs]
    images = xp.empty((tones if per_tone else 1, len(points_m)), np.complex64)
    block = max(BLOCK_BYTES // (POINT_BYTES * (n_a + n_b) * tones), 1)
    for start in range(0, len(points_m), block):
        here = slice(start, start + block)
        lengths = [passes * distances(xp, points[..., here], at) for passes, at in legs]
        paths_a, paths_b = array_legs(aperture, lengths)
        # a scan's sum over positions is a product
        received = xp.matmul(matrices, cis(xp, turns_per_m * paths_a))
        received *= cis(xp, turns_per_m * paths_b)
        part = received.sum(axis=1)
        images[:, here] = part if per_tone else part.sum(axis=0)
    return images
