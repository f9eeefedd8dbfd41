"""Imaging on the processor, by plans of the geometry.

The cells (boxes of points) of a plan are computed in parallel on all cores, and the leaves within a
cell by compiled code. Volumes are interpolated from the images at coarse nodes by matrix products
along x, y and z. A projection along z never stores the volume.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
from scipy.spatial.distance import cdist

from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.boxes import gather, radiate, to_child, to_parent
from handbench.radar.imaging.device import strongest_voxels
from handbench.radar.imaging.exact import exact_images as exact_images
from handbench.radar.imaging.plan import GridPlan, SortedPoints, TreePlan
from handbench.radar.imaging.steering import restore_carrier
from handbench.radar.imaging.tree import Node, Step
from handbench.support.parallel import for_each, one_blas_thread

Gains = Callable[
    [slice, tuple[np.ndarray, np.ndarray], list[np.ndarray], np.ndarray], list[np.ndarray]
]
BLOCK = 1024  # scatterers of a leaf whose waves are held at once
VOXELS = 1 << 16  # upsampled along z at once: they stay in the second-level cache
SAMPLES = 1 << 18  # of leaves, computed at once: 1 MB, so that calls cost little
ROWS = 16  # pixels along y of one piece of work


def image(plan: TreePlan, samples: np.ndarray, where: SortedPoints) -> np.ndarray:
    """Image points that the plan has sorted: complex64 [f, points], one image per tone, if the plan
    keeps all tones, else [1, points], the sum of all tones. The images are in the order before
    sorting. samples: complex [f, t, r], or [f, n] of a scan."""
    with one_blas_thread():
        every = np.stack([samples.real, samples.imag], axis=2).astype(np.float32)
        every = every.reshape(*every.shape[:3], -1)
        root = to_child(every, plan.root_node.turns_per_m, plan.top_node.step)
    images = np.empty((len(samples) if plan.family.per_tone else 1, len(where.order)), np.complex64)

    def work(group: tuple[int, slice]) -> None:
        cell, leaves = group
        node, stack = plan.cell(cell), plan.stack(where.leaf[leaves].tolist())
        of_cell = to_child(root, plan.top_node.turns_per_m, node.step)
        most = max(SAMPLES // of_cell.size, 1)
        below = [
            to_child(of_cell, node.turns_per_m, Step(*(part[i : i + most] for part in stack.step)))
            for i in range(0, len(stack.counts), most)
        ]
        gather(
            np.concatenate(below),
            stack.counts,
            stack.centre_m,
            stack.turns_per_m,
            stack.places,
            plan.passes,
            plan.reference_m,
            where.points_m,
            where.starts[leaves.start : leaves.stop + 1],
            images,
        )

    for_each(work, list(plan.touched(where).items()))
    unsorted = np.empty_like(images)
    unsorted[:, where.order] = images
    return unsorted


def echoes(plan: TreePlan, gains: Gains, where: SortedPoints) -> np.ndarray:
    """Compute the echo samples of point scatterers that the plan has sorted: complex64 [f, t, r],
    or [f, n, 1] for a scan. This is the adjoint of `image` with its tones summed.

    gains: function of (slice of the sorted points, (indices of transmitters [a], of receivers [b]),
    their distances from the points [[a, points], [b, points]], f/c of tones [k]) that returns their
    gains at the points, float32 [k or 1, 2, a, points] and [k or 1, 2, b, points], 2 for real and
    imaginary part.
    """
    groups = plan.touched(where)
    parts: dict[int, np.ndarray] = {}

    def work(cell: int) -> None:
        node = plan.cell(cell)
        samples = np.zeros((), np.float32)
        for i in range(len(where.leaf))[groups[cell]]:
            leaf, start, stop = plan.leaf(int(where.leaf[i])), where.starts[i], where.starts[i + 1]
            numbers = leaf.numbers[0], leaf.numbers[1]
            inner = np.zeros((), np.float32)
            for at in range(start, stop, BLOCK):
                here = slice(at, min(at + BLOCK, stop))
                points_m = np.ascontiguousarray(where.points_m[:, here].T)
                distances_m = [cdist(leg.position_m, points_m) for leg in leaf.legs]
                of_points = gains(here, numbers, distances_m, leaf.turns_per_m)
                inner = inner + radiate(
                    points_m, distances_m, of_points, leaf, plan.passes, plan.reference_m
                )
            samples = samples + _up(inner, node, leaf)
        parts[cell] = _up(samples, plan.top_node, node)

    for_each(work, list(groups))
    with one_blas_thread():  # parts are added in order: no result depends on the threads
        samples = sum((parts[cell] for cell in groups), np.zeros((), np.float32))
        every = _up(samples, plan.root_node, plan.top_node)
    return every[:, :, 0] + 1j * every[:, :, 1]


def volume(plan: GridPlan, nodes: VoxelGrid, images: np.ndarray, carrier: bool) -> np.ndarray:
    """Interpolate images [f or 1, nz, ny, nx] at the nodes to all voxels of the plan's grid:
    complex64 [f or 1, nz, ny, nx]. carrier: False leaves out the image's carrier, a fast phase that
    is the same for all tones."""
    grid, z_m = plan.grid, nodes.z_m if plan.planes else plan.grid.z_m
    volumes = np.empty((len(images), len(z_m), *grid.shape[1:]), np.complex64)

    def keep(image: int, rows: slice, re: np.ndarray, im: np.ndarray) -> None:
        if carrier:
            volumes[image, :, rows] = restore_carrier(
                re, im, grid.x_m, grid.y_m[rows], z_m, *plan.carrier
            )
        else:
            volumes[image, :, rows].real, volumes[image, :, rows].imag = re, im

    _upsample(plan, nodes, images, keep)
    return volumes


def project(plan: GridPlan, nodes: VoxelGrid, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the strongest voxel along z for each pixel of the volume that the images [1, nz, ny, nx]
    at the nodes give by interpolation, without storing the volume: (index, magnitude) as of
    `strongest`."""
    shape = plan.grid.shape[1:]
    index = np.empty(shape, np.int64)
    magnitude = np.empty((3, *shape), np.float32)

    def keep(_: int, rows: slice, re: np.ndarray, im: np.ndarray) -> None:
        index[rows], magnitude[:, rows] = strongest_voxels(re, im)

    _upsample(plan, nodes, images, keep)
    return index, magnitude


def _upsample(
    plan: GridPlan,
    nodes: VoxelGrid,
    images: np.ndarray,
    keep: Callable[[int, slice, np.ndarray, np.ndarray], None],
) -> None:
    """Interpolate the images at the nodes to all voxels, without the images' carrier, and pass the
    result on in pieces: keep(image, rows, re, im) with the index of the image, a slice along y, and
    real and imaginary parts [nz, rows, nx]."""
    count, nz, ny, _ = images.shape
    of_x, of_y, of_z = plan.weights
    nx = len(of_x)
    at_once = max(VOXELS // (nx * len(of_z)), 1)
    most = max(ROWS, at_once)
    along_x = np.empty((count, 2, nz, ny, nx), np.float32)

    def widen(part: tuple[int, slice]) -> None:
        z, rows = part
        carrier = plan.carrier_of(nodes.x_m, nodes.y_m[rows, None], nodes.z_m[z])
        envelopes = images[:, z, rows] * carrier.conj()
        along_x[:, :, z, rows] = np.stack([envelopes.real, envelopes.imag], axis=1) @ of_x.T

    def heighten(part: tuple[int, int]) -> None:
        image, first = part
        block = np.matmul(of_y[first : first + most], along_x[image])
        for start in range(0, block.shape[2], at_once):
            piece = block[:, :, start : start + at_once]
            re, im = (
                np.dot(of_z, plane.reshape(nz, -1)).reshape(-1, *plane.shape[1:]) for plane in piece
            )
            keep(image, slice(first + start, first + start + piece.shape[2]), re, im)

    halves = [slice(0, (ny + 1) // 2), slice((ny + 1) // 2, ny)]
    for_each(widen, list(product(range(nz), halves)))
    for_each(heighten, list(product(range(count), range(0, len(of_y), most))))


def _up(samples: np.ndarray, parent: Node, child: Node) -> np.ndarray:
    return to_parent(samples, parent.turns_per_m, child.step)
