"""Certificates: the relative error that an image has at most, from its own voxels and the exact sum in float64.

A tolerance is kept for echoes that are no worse than white noise. Echoes whose image is small beside them (a leak, a
target outside the box, data made for it) can miss it, and no bound that holds for any echoes is close for those at hand
(Cauchy–Schwarz: |error at p| ≤ ‖u(p) − ũ(p)‖ ‖samples‖, with u(p) the steering of p and ũ(p) what the skeletons make of
it). A certificate therefore looks at the image: a few of its voxels, half of them drawn evenly and half as likely as
they are bright, against sums of every tone and antenna in float64. Weighted by how likely they were, their squared
errors have the whole image's as their mean. Where a grid's voxels are not all kept, a few of them are formed anew from
its nodes, as the plan has it: the upsampler's own arithmetic is tested, not certified.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from radar.data.arrays import Aperture
from radar.data.grid import VoxelGrid
from radar.imaging.cpu.exact import exact_sums
from radar.imaging.plan import GridPlan

PICKS = 16  # voxels at least; more, up to all of them, as far as TERMS of the exact sum (1 ms) allow
TERMS = 1e6
# Over the root of the weighted mean: |error|² is exponential where many terms of random sign add up, and the mean of
# eight of those, half of PICKS, lies below 1/3.3² of what it stands for once in a million times.
FACTOR = 3.3
NEGLIGIBLE = 1e-2  # of the tolerance: weights of far nodes


@dataclass
class Certificate:
    """bound: relative L2 error of the worst image that was made while it was open; images: how many those were."""

    bound: float = 0.0
    images: int = 0

    def add(self, error: np.ndarray, weight: np.ndarray, mean_square: np.ndarray, factor: float) -> None:
        """Errors [f or 1, n] of one more image of mean_square [f or 1] at places of that weight [n]."""
        mean = (np.abs(error) ** 2 * weight).mean(axis=1)
        relative = np.divide(mean, mean_square, out=np.where(mean > 0, np.inf, 0.0), where=mean_square > 0)
        of_image = factor * float(np.sqrt(relative.max()))
        self.bound = max(self.bound, of_image / (1 - of_image) if of_image < 1 else np.inf)  # of the exact image
        self.images += 1


# The certificate that images are made under, if any: imaging asks here before it calls anything.
opened: ContextVar[Certificate | None] = ContextVar("certificate", default=None)


@contextmanager
def certified() -> Iterator[Certificate]:
    """Yield what the images made in the block, by this thread, are certified to."""
    certificate = Certificate()
    token = opened.set(certificate)
    try:
        yield certificate
    finally:
        opened.reset(token)


def of_points(
    certificate: Certificate,
    images: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_at_m: Callable[[np.ndarray], np.ndarray],
) -> None:
    """Certify images [f or 1, n]; points_at_m: index [k] → their points [k, 3]."""
    count, n = _count(samples), images.shape[1]
    power, mean_square = _power(images, np.ones(n, np.int8))
    if whole := n <= count:
        index, weight = np.arange(n), np.ones(n)
    else:
        index, weight = picked(power, np.ones(n, np.int8), count)
    exact = exact_sums(samples, frequencies_hz, aperture, points_at_m(index), len(images) > 1)
    error = images[:, index] - exact
    certificate.add(error, weight, mean_square, 1.0 if whole else FACTOR)


def of_nodes(
    certificate: Certificate,
    plan: GridPlan,
    nodes: VoxelGrid,
    images: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
) -> None:
    """Certify the voxels that follow from the nodes' images [f or 1, nz, ny, nx]."""
    grid = VoxelGrid(plan.grid.x_m, plan.grid.y_m, nodes.z_m) if plan.planes else plan.grid
    nearest = [_nearest(axis, node) for axis, node in zip(_axes(grid), _axes(nodes), strict=True)]  # z, y, x
    z, y, x = (np.bincount(near, minlength=len(node)) for near, node in zip(nearest, _axes(nodes), strict=True))
    counts = (z[:, None, None] * y[:, None] * x).ravel()
    power, mean_square = _power(images.reshape(len(images), -1), counts)
    index, weight = picked(power, counts, _count(samples))
    generator = np.random.default_rng(power.size)
    places = np.unravel_index(index, nodes.shape)
    voxels = np.stack([  # any of the voxels that are nearest to a node
        [generator.choice(np.flatnonzero(near == place)) for place in along]
        for near, along in zip(nearest, places, strict=True)
    ])  # fmt: skip
    points_m = np.stack([axis[voxel] for axis, voxel in zip(_axes(grid), voxels, strict=True)], axis=1)[:, ::-1]
    exact = exact_sums(samples, frequencies_hz, aperture, points_m, len(images) > 1)
    found = np.stack(
        [_voxel(plan, nodes, images, voxel, point) for voxel, point in zip(voxels.T, points_m, strict=True)], axis=1
    )
    certificate.add(found - exact, weight, mean_square, FACTOR)


def picked(power: np.ndarray, counts: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """So many places of an image and their weights, from its power [n] and how many voxels each place stands for [n]:
    (index [count], weight [count]). The weighted mean of any quantity at them is on average its mean over all voxels.
    """
    generator = np.random.default_rng(power.size)
    even, bright = 1 / counts.sum(dtype=np.float64), np.dot(power, counts)
    likely = power * np.float32(0.5 / bright if bright > 0 else 0.0)
    likely += np.float32((0.5 if bright > 0 else 1.0) * even)
    ladder = np.cumsum(likely * counts, dtype=np.float64)
    index = np.searchsorted(ladder, (np.arange(count) + generator.random(count)) / count * ladder[-1])
    return index, even * ladder[-1] / likely[index]


def _count(samples: np.ndarray) -> int:
    return max(PICKS, int(TERMS / samples.size))


def _power(images: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Power [n] of all images [f or 1, n] together, relative to their largest part so that float32 holds it, and the
    mean square of each [f or 1] over what its places stand for."""
    largest = float(max(np.abs(part).max() for image in images for part in (image.real, image.imag))) or 1.0
    together, means = np.zeros(images.shape[1], np.float32), []
    for image in images:
        power = np.square(image.real / np.float32(largest)) + np.square(image.imag / np.float32(largest))
        means.append(float(np.dot(power, counts)) / float(counts.sum(dtype=np.float64)) * largest**2)
        together += power
    return together, np.array(means)


def _axes(grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return grid.z_m, grid.y_m, grid.x_m


def _nearest(axis_m: np.ndarray, node_m: np.ndarray) -> np.ndarray:
    """Index of the nearest of node_m [n] (ascending) to each of axis_m."""
    return np.searchsorted((node_m[1:] + node_m[:-1]) / 2, axis_m)


def _voxel(plan: GridPlan, nodes: VoxelGrid, images: np.ndarray, voxel: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    """Images [f or 1] of the voxel [3] (z, y, x), from the nodes around it."""
    (z, of_z), (y, of_y), (x, of_x) = (
        resampler.of(int(at), NEGLIGIBLE * plan.tolerance)
        for resampler, at in zip((plan.z, plan.y, plan.x), voxel, strict=True)
    )
    envelopes = images[:, z, y, x] * plan.carrier_at(VoxelGrid(nodes.x_m[x], nodes.y_m[y], nodes.z_m[z])).conj()
    here = plan.carrier_at(VoxelGrid(*point_m[:, None]))
    return envelopes @ of_x @ of_y @ of_z * here[0, 0, 0]
