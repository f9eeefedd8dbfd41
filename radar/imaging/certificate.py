"""Certificates: the relative error that an image has at most, from its own voxels and the exact sum
in float64.

A tolerance is kept for echoes that are no worse than white noise. Echoes whose image is small
beside them (a leak, a target outside the box, data made for it) can miss it, and no bound that
holds for any echoes is close for those at hand (Cauchy–Schwarz: |error at p| ≤ ‖u(p) − ũ(p)‖
‖samples‖, with u(p) the steering of p and ũ(p) what the skeletons make of it). A certificate
therefore looks at the image: a few of its voxels, half of them drawn evenly and half as likely as
they are bright, against sums of every tone and antenna in float64. Weighted by how likely they
were, their squared errors have the whole image's as their mean. Where a grid's voxels are not all
kept, a few of them are formed anew from its nodes, as the plan has it: the upsampler's own
arithmetic is tested, not certified.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import AntennaArray, Aperture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.cpu.exact import check_samples, exact_sums
from handbench.radar.imaging.peaks import root_mean_square
from handbench.radar.imaging.plan import GridPlan

# voxels at least; more, up to all of them and to MOST, as far as TERMS of the exact sum (1 ms)
# allow
PICKS = 16
TERMS, MOST = 1e6, 512
# Over the root of the weighted mean: |error|² is exponential where many terms of random sign add
# up, and the mean of eight of those, half of PICKS, lies below 1/3.3² of what it stands for once in
# a million times.
FACTOR = 3.3
ROUNDED = 1 + 1e-5  # of mean squares in single precision, where all voxels are looked at
NEGLIGIBLE = 1e-2  # of the tolerance: weights of far nodes


@dataclass
class Certificate:
    """bound: relative L2 error of the worst image that was made while it was open; images: how many
    those were."""

    bound: float = 0.0
    images: int = 0

    def add(
        self, error: np.ndarray, weight: np.ndarray, mean_square: np.ndarray, factor: float
    ) -> None:
        """Errors [f or 1, n] of one more image of mean_square [f or 1] at places of that weight
        [n]."""
        mean = (np.abs(error) ** 2 * weight).mean(axis=1)
        relative = np.divide(
            mean, mean_square, out=np.where(mean > 0, np.inf, 0.0), where=mean_square > 0
        )
        of_image = factor * float(np.sqrt(relative.max()))
        self.bound = max(
            self.bound, of_image / (1 - of_image) if of_image < 1 else np.inf
        )  # of the exact image
        self.images += 1


# The certificate that images are made under, if any.
_opened: ContextVar[Certificate | None] = ContextVar("certificate", default=None)


@contextmanager
def certified() -> Iterator[Certificate]:
    """Yield what the images made in the block, by this thread, are certified to."""
    certificate = Certificate()
    token = _opened.set(certificate)
    try:
        yield certificate
    finally:
        _opened.reset(token)


def imaging_error(
    image: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    count: int = 500,
    seed: int = 0,
) -> float:
    """A-posteriori check: relative L2 error of a volume [nz, ny, nx] at `count` random voxels
    against the exact sum in float64, relative to the whole volume's own size."""
    check_samples(samples, frequencies_hz, aperture)
    picked = np.random.default_rng(seed).integers(0, image.size, count)
    exact = exact_sums(samples, frequencies_hz, aperture, grid.points_at_m(picked))[0]
    return float(
        np.divide(root_mean_square(image.ravel()[picked] - exact), root_mean_square(image))
    )


def certify_points(
    images: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_at_m: Callable[[np.ndarray], np.ndarray],
) -> None:
    """Certify images [f or 1, rows, n], where a certificate is open; points_at_m: flat index [k] →
    points [k, 3]."""
    if (certificate := _opened.get()) is None:
        return
    samples, aperture = _live_antennas(samples, aperture)
    bright = ImagePower(images, *(np.ones(n, np.int64) for n in images.shape[1:]))
    count = _count(samples)
    if whole := bright.voxels <= count:
        index, weight = np.arange(bright.voxels), np.ones(bright.voxels)
    else:
        places, weight = draw_places(bright, count)
        index = np.ravel_multi_index(places, images.shape[1:])
    exact = exact_sums(samples, frequencies_hz, aperture, points_at_m(index), len(images) > 1)
    error = images.reshape(len(images), -1)[:, index] - exact
    certificate.add(error, weight, bright.mean_square(), ROUNDED if whole else FACTOR)


def certify_nodes(
    plan: GridPlan,
    nodes: VoxelGrid,
    images: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
) -> None:
    """Certify the voxels that follow from the nodes' images [f or 1, nz, ny, nx], where a
    certificate is open."""
    if (certificate := _opened.get()) is None:
        return
    samples, aperture = _live_antennas(samples, aperture)
    grid = VoxelGrid(plan.grid.x_m, plan.grid.y_m, nodes.z_m) if plan.planes else plan.grid
    axes = zip(
        _axes(grid), _axes(nodes), strict=True
    )  # z, y, x; each voxel counts for the nearest node
    nearest = [np.searchsorted((node_m[1:] + node_m[:-1]) / 2, axis_m) for axis_m, node_m in axes]
    z, y, x = (
        np.bincount(near, minlength=len(node))
        for near, node in zip(nearest, _axes(nodes), strict=True)
    )
    bright = ImagePower(images.reshape(len(images), -1, len(x)), np.outer(z, y).ravel(), x)
    (row, along), weight = draw_places(bright, _count(samples))
    places, generator = (row // len(y), row % len(y), along), np.random.default_rng(images.size)
    voxels = np.stack([  # any of the voxels that are nearest to a node
        np.searchsorted(near, place) + (generator.random(len(place)) * voxels[place]).astype(int)
        for near, place, voxels in zip(nearest, places, (z, y, x), strict=True)
    ])  # fmt: skip
    points_m = np.stack(
        [axis[voxel] for axis, voxel in zip(_axes(grid), voxels, strict=True)], axis=1
    )[:, ::-1]
    exact = exact_sums(samples, frequencies_hz, aperture, points_m, len(images) > 1)
    smooth = np.stack([_voxel(plan, nodes, images, voxel) for voxel in voxels.T], axis=1)
    found = smooth * plan.carrier_of(*points_m.T)
    certificate.add(found - exact, weight, bright.mean_square(), FACTOR)


class ImagePower:
    """Power of images [f or 1, rows, n] whose places stand for rows [rows] × counts [n] voxels,
    relative to their largest part so that float32 holds it."""

    def __init__(self, images: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> None:
        self.images, self.rows, self.counts = images, rows, counts
        parts, twice = (
            np.ascontiguousarray(images).view(np.float32),
            np.repeat(counts, 2).astype(np.float32),
        )
        self.largest = float(max(parts.max(), -parts.min())) or 1.0
        scale = np.float32(1 / self.largest)
        squares = (np.square(image * scale) for image in parts)
        self.of_rows = np.stack([np.einsum("rn,n->r", square, twice) for square in squares]).astype(
            np.float64
        )

    @property
    def voxels(self) -> int:
        """Voxels that the places stand for."""
        return int(self.rows.sum()) * int(self.counts.sum())

    def mean_square(self) -> np.ndarray:
        """Mean |O|² of each image over its voxels [f or 1]."""
        return self.of_rows @ self.rows / self.voxels * self.largest**2

    def along(self, row: np.ndarray) -> np.ndarray:
        """Power of all images together in some rows [k]: [k, n]."""
        return (np.abs(self.images[:, row] / self.largest).astype(np.float64) ** 2).sum(axis=0)


def draw_places(bright: ImagePower, count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """So many places of images: (row and place in it, [count] each), weight [count]. The weighted
    mean of any quantity at them is on average its mean over all voxels."""
    rows, counts, power = bright.rows, bright.counts, bright.of_rows.sum(axis=0)
    generator = np.random.default_rng(len(rows) * len(counts))
    even, total = 1 / bright.voxels, float(power @ rows)
    of_even, of_power = (0.5 * even, 0.5 / total) if total > 0 else (even, 0.0)
    ladder = np.r_[0.0, np.cumsum(rows * (of_even * counts.sum() + of_power * power))]
    at = (np.arange(count) + generator.random(count)) / count * ladder[-1]
    row = np.searchsorted(ladder[1:], at)
    likely = of_even + of_power * bright.along(row)
    steps = np.cumsum(counts * likely, axis=1)
    inside = (at - ladder[row]) / (ladder[row + 1] - ladder[row])  # share of the row before it
    place = (steps < inside[:, None] * steps[:, -1:]).sum(axis=1)
    return (row, place), even * ladder[-1] / likely[np.arange(count), place]


def _count(samples: np.ndarray) -> int:
    return min(
        max(PICKS, int(TERMS / (samples.size + samples.shape[0] * sum(samples.shape[1:])))), MOST
    )


def _live_antennas(samples: np.ndarray, aperture: Aperture) -> tuple[np.ndarray, Aperture]:
    """Samples and aperture without antennas that no sample stems from. Where few are left, many
    leaves of a plan keep all of them and have no error, and the more voxels are looked at."""
    heard: np.ndarray = samples[0]
    if not heard.all():
        heard = np.any(samples, axis=0)
    if heard.all() or not heard.any():
        return samples, aperture
    if not isinstance(aperture, AntennaArray):
        return samples[:, heard], type(aperture)(
            *(places_m[heard] for places_m in vars(aperture).values())
        )
    t, r = heard.any(axis=1), heard.any(axis=0)
    return samples[:, t][:, :, r], AntennaArray(aperture.tx_m[t], aperture.rx_m[r])


def _axes(grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return grid.z_m, grid.y_m, grid.x_m


def _voxel(plan: GridPlan, nodes: VoxelGrid, images: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """Images [f or 1] of the voxel [3] (z, y, x) without its carrier, from the nodes around it."""
    (z, of_z), (y, of_y), (x, of_x) = (
        resampler.of(int(at), NEGLIGIBLE * plan.tolerance)
        for resampler, at in zip((plan.z, plan.y, plan.x), voxel, strict=True)
    )
    carrier = plan.carrier_of(nodes.x_m[x], nodes.y_m[y, None], nodes.z_m[z, None, None])
    return (images[:, z, y, x] * carrier.conj()) @ of_x @ of_y @ of_z
