"""Plans: everything that imaging and simulation compute from the geometry alone, for a box of
points or a voxel grid.

A plan uses no samples. Executors (`radar.imaging.cpu`, `radar.imaging.gpu`) apply
it to samples, for images of points, for their adjoint (echoes of points), and for volumes by
band-limited upsampling. Plans are cached per geometry.
"""

import hashlib
import pickle
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from math import prod
from threading import Lock
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture
from handbench.radar.data.grid import MOST_ON_AXIS, VoxelGrid
from handbench.radar.imaging.device import Array, cis, distances
from handbench.radar.imaging.skeleton import resampler_for_channels
from handbench.radar.imaging.tree import (
    DIRECT,
    Box,
    Family,
    Node,
    NodeStack,
    child_node,
    needs_direct_sum,
    root_node,
    stack,
)
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.parallel import one_blas_thread

COARSER = "make the grid's steps larger"
LEAF = 7.0  # Nyquist intervals along each axis of a leaf, at most ...
# ... and leaves along each axis of a cell: the balance of compressing against evaluating
LEAVES_PER_CELL_SIDE = 3
PROBES = 7  # points along each axis of a box at which the local band is looked up
NODE_BYTES = 100  # a node's position, order and images
UPSAMPLING = 0.6  # share of the tolerance that upsampling may use
CACHED = 48  # plans, those of a benchmark's dozen methods; the oldest goes first
# Cost of planning a node, in terms of the exact sum: GRAMS times its antennas' Gram matrices, and
# at least SMALL_NODE. A grid's plan, which later images reuse, may always cost PLANNED (some 3 s);
# a dearer plan must cost less than the exact sum of its image. So must a plan for points, of REUSED
# images: those of a frame that moves, or of other tones.
GRAMS, SMALL_NODE, PLANNED, REUSED = 3, 1.5e6, 3e10, 8
# cost of a term of a scan's sum over positions relative to one of a matrix product (measured: 14 to
# 19)
SCAN = 16

Built = TypeVar("Built")

_cache: OrderedDict[bytes, Any] = OrderedDict()
_lock = Lock()


class SortedPoints(NamedTuple):
    """Points sorted by the leaves (smallest boxes) of a plan.

    points_m [3, n]; order [n]: their indices before sorting; leaf [m]: numbers of the leaves that
    contain points, counted over all cells; starts [m + 1]: index at which the points of each of
    these begin.
    """

    points_m: np.ndarray
    order: np.ndarray
    leaf: np.ndarray
    starts: np.ndarray


class TreePlan:
    """The division of a box into smaller boxes, for fast imaging and simulation of points in it:
    the box is divided into cells, each cell into leaves.

    Each of these boxes keeps only the tones and antennas that its points need
    (`radar.imaging.tree`). root_node has those of all space and top_node those of the whole box;
    those of cells and leaves are computed when they are first used, and then kept.
    """

    def __init__(
        self, frequencies_hz: np.ndarray, aperture: Aperture, box: Box, family: Family
    ) -> None:
        self.box, self.family = box, family
        low, high = bands(frequencies_hz, aperture, box)
        leaves = np.maximum(
            np.ceil((box.high_m - box.low_m) * (high - low) / 2 / np.pi / LEAF), 1
        ).astype(int)
        self.cells = np.maximum(np.round(leaves / LEAVES_PER_CELL_SIDE), 1).astype(int)
        self.leaves = np.ceil(leaves / self.cells).astype(int)  # of each cell
        self.leaves_per_cell = prod(self.leaves.tolist())
        self.passes, self.reference_m = carriers(aperture)
        self.root_node = root_node(frequencies_hz, aperture)
        self.top_node = child_node(self.root_node, box, family, keep_antennas=True)
        self._cells: dict[int, Node] = {}
        self._leaves: dict[int, Node] = {}
        self._stacks: dict[int, tuple[list[int], NodeStack]] = {}

    def cell(self, cell: int) -> Node:
        """Return the node (tones, antennas and their weights) of the cell with this number."""
        if cell not in self._cells:
            box = self.box.part(self.cells, cell)
            self._cells[cell] = child_node(self.top_node, box, self.family)
        return self._cells[cell]

    def leaf(self, leaf: int) -> Node:
        """Return the node of the leaf with this number, counted over all cells."""
        if leaf not in self._leaves:
            cell, place = divmod(leaf, self.leaves_per_cell)
            parent = self.cell(cell)
            box = parent.box.part(self.leaves, place)
            self._leaves[leaf] = child_node(parent, box, self.family)
        return self._leaves[leaf]

    def touched(self, where: SortedPoints) -> dict[int, slice]:
        """Find the cells that contain sorted points: cell → slice of `where.leaf`, its leaves."""
        cells, first = np.unique(where.leaf // self.leaves_per_cell, return_index=True)
        bounds = pairwise([*first.tolist(), len(where.leaf)])
        return {cell: slice(*ends) for cell, ends in zip(cells.tolist(), bounds, strict=True)}

    def stack(self, leaves: list[int]) -> NodeStack:
        """Return the nodes of some leaves of one cell, whose numbers ascend. They are taken from a
        stack of all leaves of this cell that were asked for so far."""
        cell = leaves[0] // self.leaves_per_cell
        numbers, stacked = self._stacks.get(cell, ([], None))
        if stacked is None or not set(leaves) <= set(numbers):
            numbers = sorted({*numbers, *leaves})
            stacked = stack([self.leaf(leaf) for leaf in numbers])
            self._stacks[cell] = numbers, stacked
        return stacked if leaves == numbers else stacked.part(np.searchsorted(numbers, leaves))

    def sort(self, points_m: np.ndarray) -> SortedPoints:
        """Sort points [n, 3] of the box, in metres, by the cell and leaf (smaller boxes) that
        contain them."""
        counts = self.cells * self.leaves
        extent = np.maximum(self.box.high_m - self.box.low_m, np.finfo(float).tiny)
        place = np.clip(((points_m - self.box.low_m) / extent * counts).astype(int), 0, counts - 1)
        cell, leaf = np.divmod(place, self.leaves)
        key = np.ravel_multi_index(cell.T, self.cells) * self.leaves_per_cell
        key += np.ravel_multi_index(leaf.T, self.leaves)
        order = np.argsort(key, kind="stable")
        numbers, starts = np.unique(key[order], return_index=True)
        starts = np.append(starts, len(key))
        return SortedPoints(
            np.ascontiguousarray(points_m[order].T, np.float64), order, numbers, starts
        )


class GridPlan:
    """The coarse grid of nodes that is imaged in place of a voxel grid, and the interpolation
    from the nodes to all voxels. weights: of the interpolation along x, y and z (`resampler`).

    planes: the plan serves any single plane between the grid's first and last z. tree: plan for
    imaging the nodes; None if they are summed exactly, because choosing few tones and antennas
    costs more than it saves (too many antennas, too few nodes). Raises HandbenchError for an
    axis of more than MOST_ON_AXIS samples.

    Only the image's envelope is interpolated, which is the image divided by its carrier and varies
    as slowly as the array's angles and bandwidth allow. The carrier is exp(jk_c R) times a linear
    phase that centres the band of spatial frequencies; R is the path from the mean position of the
    transmitters to the voxel to that of the receivers, and k_c the middle wavenumber.
    """

    def __init__(
        self,
        frequencies_hz: np.ndarray,
        aperture: Aperture,
        grid: VoxelGrid,
        family: Family,
        planes: bool = False,
    ) -> None:
        axes = (grid.x_m, grid.y_m, grid.z_m)
        for name, axis in zip("xyz", axes, strict=True):
            if len(axis) > MOST_ON_AXIS:
                raise HandbenchError(
                    f"grid: has {len(axis)} samples along {name}, more than {MOST_ON_AXIS}; "
                    f"{COARSER}, or image it in parts"
                )
        low_m, high_m = grid.ends_m
        low, high = bands(frequencies_hz, aperture, Box(low_m, high_m))
        middle = (np.min(frequencies_hz) + np.max(frequencies_hz)) / 2 / SPEED_OF_LIGHT_M_S
        self.carrier = (middle, *carriers(aperture), (low + high) / (4 * np.pi))
        antennas_m = np.concatenate([leg.position_m for leg in aperture.legs])
        array_m = (antennas_m.min(axis=0), antennas_m.mean(axis=0), antennas_m.max(axis=0))
        places_m = np.clip([low_m, (low_m + high_m) / 2, high_m, *array_m], low_m, high_m)
        resamplers = (
            (axis, np.ones((1, 1), np.float32))
            if planes and axis is grid.z_m
            else resampler_for_channels(
                axis,
                half,
                UPSAMPLING * family.tolerance,
                partial(self._channels, frequencies_hz, aperture, places_m, along),
            )
            for along, (axis, half) in enumerate(zip(axes, (high - low) / 2, strict=True))
        )
        self.grid, self.planes, self.family = grid, planes, family
        nodes_m, self.weights = zip(*resamplers, strict=True)
        self.nodes = VoxelGrid(*nodes_m)
        along_x = self.nodes.shape[0] * self.nodes.shape[1] * len(grid.x_m)
        images = len(frequencies_hz) if family.per_tone else 1
        needed = images * (NODE_BYTES * int(np.prod(self.nodes.shape)) + 8 * along_x)
        require_memory(needed, f"grid of {grid.shape} voxels [nz, ny, nx]", COARSER)
        self.tree = (
            None
            if needs_direct_sum(aperture)
            else TreePlan(frequencies_hz, aperture, Box(*self.nodes.ends_m), family)
        )
        if self.tree is not None:
            first = self.nodes_at(self.nodes.z_m[:1])
            self._sorted = self.tree.sort(first.points_m().reshape(-1, 3))
            terms = exact_terms(int(np.prod(self.nodes.shape)) * len(frequencies_hz), aperture)
            if planning_terms(self._sorted, self.tree, aperture) > max(PLANNED, terms):
                self.tree = None

    def nodes_at(self, z_m: np.ndarray) -> VoxelGrid:
        """Return the grid of the coarse nodes. z_m [1]: depth of the plane, if the plan is for
        single planes; otherwise ignored."""
        return VoxelGrid(self.nodes.x_m, self.nodes.y_m, z_m) if self.planes else self.nodes

    def carrier_at(self, grid: VoxelGrid, xp: Any = np) -> Array:
        """Compute the carrier at all voxels of a grid: complex64 [nz, ny, nx]. The carrier is the
        fast phase factor that is removed from images before interpolation and restored after it.
        xp: the array module that computes it, numpy or cupy."""
        z, y, x = (
            xp.asarray(axis) for axis in (grid.z_m[:, None, None], grid.y_m[:, None], grid.x_m)
        )
        return self.carrier_of(x, y, z, xp)

    def carrier_of(self, x: Array, y: Array, z: Array, xp: Any = np) -> Array:
        """Compute the carrier, the fast phase factor that is removed from images before
        interpolation, at coordinates x, y, z (metres, arrays that broadcast): complex64. xp: the
        array module that computes it, numpy or cupy."""
        turns_per_m, passes, reference_m, ramp = self.carrier
        turns = ramp[0] * x + ramp[1] * y + ramp[2] * z
        for count, reference in zip(passes, reference_m, strict=True):
            turns += turns_per_m * count * distances(xp, (x, y, z), reference)
        return cis(xp, turns)

    def _channels(
        self,
        frequencies_hz: np.ndarray,
        aperture: Aperture,
        places_m: np.ndarray,
        along: int,
        axis_m: np.ndarray,
    ) -> np.ndarray:
        """Compute what single channels contribute to an image, without its carrier: complex64 [n,
        lines, m], at axis_m [n] on lines along one axis (0, 1, 2 for x, y, z) through all
        combinations of the other two coordinates of places_m [k, 3].

        The m channels pair the outermost and the middle antennas of both legs (transmitters and
        receivers), at the lowest and the highest tone.
        """
        sides = [np.unique(place_m) for place_m in places_m.T]
        sides[along] = axis_m
        grid_m = np.moveaxis(np.array(np.meshgrid(*sides, indexing="ij")), along + 1, 1)
        points_m = grid_m.reshape(3, len(axis_m), -1, 1)
        path_m = sum(
            leg.passes * distances(np, points_m, _outermost(leg.position_m).T)
            for leg in aperture.legs
        )
        ends_hz = np.array([np.min(frequencies_hz), np.max(frequencies_hz)])
        turns = np.multiply.outer(ends_hz / SPEED_OF_LIGHT_M_S, path_m)
        waves = cis(np, turns) * self.carrier_of(*points_m).conj()
        return np.concatenate(waves, axis=-1)

    def sort(self, nodes: VoxelGrid) -> SortedPoints:
        """Sort the nodes, `nodes_at` any depth, by the tree's cells and leaves. The order is that
        of the first depth, unless the leaves of a plan for planes form several layers along z."""
        assert self.tree is not None
        if not self.planes:
            return self._sorted
        if self.tree.cells[2] * self.tree.leaves[2] > 1:
            return self.tree.sort(nodes.points_m().reshape(-1, 3))
        points_m = self._sorted.points_m.copy()
        points_m[2] = nodes.z_m
        return self._sorted._replace(points_m=points_m)


def _outermost(position_m: np.ndarray) -> np.ndarray:
    """Return the antennas with the least and the largest x, y and z among position_m [n, 3], and
    the one nearest to their mean: [7, 3]."""
    middle = np.linalg.norm(position_m - position_m.mean(axis=0), axis=1).argmin()
    return position_m[[*position_m.argmin(axis=0), *position_m.argmax(axis=0), middle]]


def node_cost(aperture: Aperture) -> float:
    """Return the cost of choosing tones and antennas for one box (a cell or a leaf). Unit: one term
    of an array's exact sum, for one point, tone and channel."""
    antennas = [float(len(leg.position_m)) for leg in aperture.legs]
    return max(GRAMS * sum(n * min(n, DIRECT) ** 2 for n in antennas), SMALL_NODE)


def planning_terms(where: SortedPoints, plan: TreePlan, aperture: Aperture) -> float:
    """Return the cost of choosing tones and antennas for the cells and leaves that contain points.
    Unit: one term of an array's exact sum, for one point, tone and channel."""
    return (len(plan.touched(where)) + len(where.leaf)) * node_cost(aperture)


def exact_terms(images: int, aperture: Aperture) -> float:
    """Return the cost of an exact sum. Unit: one term of an antenna array's exact sum, for one
    point, tone and channel; a term of a scan costs SCAN of these, since it is slower.

    images: number of points times number of tones.
    """
    return (
        float(images)
        * prod(aperture.channels)
        * (1 if isinstance(aperture, AntennaArray) else SCAN)
    )


def carriers(aperture: Aperture) -> tuple[np.ndarray, np.ndarray]:
    """Return the reference path whose phase is the carrier of images. It goes from the mean
    position of the transmitters to the point and on to that of the receivers.

    Returns (how often the path passes each of the two legs [2], mean positions [2, 3] in metres).
    The path of a planar scan passes its one leg twice and the other, which has no length, zero
    times.
    """
    passes = np.array([float(leg.passes) for leg in aperture.legs])
    return passes, np.array([leg.position_m.mean(axis=0) for leg in aperture.legs])


def bands(
    frequencies_hz: np.ndarray, aperture: Aperture, box: Box
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the lowest and the highest spatial frequency of an image along x, y, z within the
    box, after its carrier exp(jk_c R) is removed: ([3], [3]), rad/m. R is the path from the mean
    position of the transmitters to the point to that of the receivers, and k_c the middle
    wavenumber."""
    wavenumber = 2 * np.pi * np.asarray(frequencies_hz) / SPEED_OF_LIGHT_M_S
    k_c = (wavenumber.min() + wavenumber.max()) / 2
    axes = [
        np.linspace(low, high, PROBES if high > low else 1) for low, high in zip(*box, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    low, high = np.zeros_like(points), np.zeros_like(points)
    for leg, passes, reference_m in zip(aperture.legs, *carriers(aperture), strict=True):
        about = k_c * passes * _direction(points, reference_m)
        least, most = np.full_like(points, np.inf), np.full_like(points, -np.inf)
        for antenna in leg.position_m:
            seen = leg.passes * _direction(points, antenna)
            np.minimum(least, seen, out=least)
            np.maximum(most, seen, out=most)
        ends = wavenumber.min(), wavenumber.max()
        low += np.minimum(ends[0] * least, ends[1] * least) - about
        high += np.maximum(ends[0] * most, ends[1] * most) - about
    return low.min(axis=0), high.max(axis=0)


def _direction(points_m: np.ndarray, antenna_m: np.ndarray) -> np.ndarray:
    towards = points_m - antenna_m
    return towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-12)[:, None]


def lattice_box(low_m: np.ndarray, high_m: np.ndarray) -> Box:
    """Enlarge the box from low_m to high_m [3] so that its corners lie on a coarse lattice. Points
    of successive frames, which differ little, then have the same box and share a plan."""
    extent = high_m - low_m
    step = 2.0 ** np.ceil(np.log2(np.maximum(np.maximum(extent, extent.max() / 16), 1e-4) / 2))
    return Box(np.floor(low_m / step) * step, np.ceil(high_m / step) * step)


@contextmanager
def fresh_plans() -> Iterator[None]:
    """Run the `with` block with an empty cache of plans, as in a new process, and restore the old
    cache after it."""
    global _cache
    before, _cache = _cache, OrderedDict()
    try:
        yield
    finally:
        _cache = before


def cached_plan(kind: Callable[..., Built], *arguments: Any) -> Built:
    """Return the plan kind(*arguments) from the cache, or compute it if there is none for equal
    arguments. The cache keeps the CACHED plans used last."""
    key = hashlib.blake2b(pickle.dumps((kind.__name__, arguments))).digest()
    with _lock:
        if key not in _cache:
            # rounding, and with it the plan, must not depend on the number of threads
            with one_blas_thread():
                _cache[key] = kind(*arguments)
            if len(_cache) > CACHED:
                _cache.popitem(last=False)
        _cache.move_to_end(key)
        return cast(Built, _cache[key])
