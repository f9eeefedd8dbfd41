"""Certificates: upper bounds of an image's relative error, from some of its voxels and exact sums
in float64.

The tolerance holds for echoes that are no worse than white noise. Echoes with a weak image
(leakage, a target outside the box, adversarial data) can exceed it, and a bound that holds for all
echoes is far too loose for given ones (Cauchy–Schwarz: |error at p| ≤ ‖u(p) − ũ(p)‖ ‖samples‖, u(p)
the steering vector and ũ(p) its skeleton approximation). A certificate therefore samples the image:
it compares a few voxels with the sum over every tone and antenna in float64. Half of the voxels are
drawn uniformly, half with a probability proportional to their power; importance weights make their
mean squared error an unbiased estimate of the whole image's. For a projection, whose voxels are not
stored, these voxels are recomputed from the coarse nodes; the upsampler's arithmetic is covered by
tests, not by the certificate.
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

# least number of voxels; more, up to MOST, as far as TERMS of the exact sum (1 ms) allow
PICKS = 16
TERMS, MOST = 1e6, 512
# Factor on the root of the weighted mean: |error|² is exponentially distributed where many terms of
# random sign add up, and the mean of eight such numbers, half of PICKS, is below 1/3.3² of its
# expectation once in a million times.
FACTOR = 3.3
ROUNDED = 1 + 1e-5  # rounding of mean squares in single precision, where all voxels are compared
NEGLIGIBLE = 1e-2  # weights of far nodes below this share of the tolerance are left out


@dataclass
class Certificate:
    """A measured bound of the error of images, collected while the certificate is open
    (`certified`).

    bound: upper bound of the relative L2 error of the worst of these images; images: their number.
    """

    bound: float = 0.0
    images: int = 0

    def add(
        self, error: np.ndarray, weight: np.ndarray, mean_square: np.ndarray, factor: float
    ) -> None:
        """Raise the bound to that of one more image, if it is larger.

        error [f or 1, n]: complex errors at n compared voxels; weight [n]: their importance
        weights, so that the weighted mean estimates that of all voxels; mean_square [f or 1]: of
        the whole image; factor: on the estimated relative error, for the few voxels compared.
        """
        mean = (np.abs(error) ** 2 * weight).mean(axis=1)
        relative = np.divide(
            mean, mean_square, out=np.where(mean > 0, np.inf, 0.0), where=mean_square > 0
        )
        of_image = factor * float(np.sqrt(relative.max()))
        # of the exact image
        self.bound = max(self.bound, of_image / (1 - of_image) if of_image < 1 else np.inf)
        self.images += 1


# The open certificate, if any.
_opened: ContextVar[Certificate | None] = ContextVar("certificate", default=None)


@contextmanager
def certified() -> Iterator[Certificate]:
    """Yield a `Certificate` that bounds the error of all images this thread makes in the `with`
    block."""
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
    """Estimate the relative L2 error of a volume [nz, ny, nx] from `count` random voxels: the root
    mean square of their differences from exact sums in float64, over the root mean square of the
    whole volume. seed: of the random choice."""
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
    """Compare some of the images [f or 1, rows, n] with exact sums, and add the error to the open
    certificate; without one, do nothing. points_at_m: function from flat indices [k] of an image to
    points [k, 3], metres."""
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
    """Compare some voxels, interpolated from the coarse nodes' images [f or 1, nz, ny, nx], with
    exact sums, and add the error to the open certificate; without one, do nothing."""
    if (certificate := _opened.get()) is None:
        return
    samples, aperture = _live_antennas(samples, aperture)
    grid = VoxelGrid(plan.grid.x_m, plan.grid.y_m, nodes.z_m) if plan.planes else plan.grid
    # z, y, x; each voxel counts for the nearest node
    axes = zip(_axes(grid), _axes(nodes), strict=True)
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
    """The power of images [f or 1, rows, n], from which voxels are drawn. A pixel at row i, column
    j represents rows[i] × counts[j] voxels. of_rows [f or 1, rows] and `along` are relative to
    `largest`², the square of the largest real or imaginary part, so that float32 holds them."""

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
        """Number of voxels that all pixels represent."""
        return int(self.rows.sum()) * int(self.counts.sum())

    def mean_square(self) -> np.ndarray:
        """Return the mean |O|² of each image over the voxels that its pixels represent: [f or
        1]."""
        return self.of_rows @ self.rows / self.voxels * self.largest**2

    def along(self, row: np.ndarray) -> np.ndarray:
        """Return the power of the pixels in some rows [k], relative to `largest`² and summed over
        the images: [k, n]."""
        return (np.abs(self.images[:, row] / self.largest).astype(np.float64) ** 2).sum(axis=0)


def draw_places(bright: ImagePower, count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Draw `count` pixels of images, half of them evenly over the voxels, half in proportion to
    power: ((rows, columns), each [count], and weights [count]).

    The weighted mean of a quantity over the drawn pixels has the quantity's mean over all voxels as
    expectation. The same images always give the same pixels.
    """
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
    """Leave out antennas whose samples are all zero: (samples, aperture). The sum is the same and
    cheaper, so more voxels are compared; where few antennas are left, many boxes keep all of them
    and are exact."""
    live: np.ndarray = samples[0]
    if not live.all():
        live = np.any(samples, axis=0)
    if live.all() or not live.any():
        return samples, aperture
    if not isinstance(aperture, AntennaArray):
        return samples[:, live], type(aperture)(
            *(places_m[live] for places_m in vars(aperture).values())
        )
    t, r = live.any(axis=1), live.any(axis=0)
    return samples[:, t][:, :, r], AntennaArray(aperture.tx_m[t], aperture.rx_m[r])


def _axes(grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return grid.z_m, grid.y_m, grid.x_m


def _voxel(plan: GridPlan, nodes: VoxelGrid, images: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """Interpolate the envelope (the image without its carrier) at one voxel, indices [3] (z, y, x),
    from the nodes around it: [f or 1]."""
    (z, of_z), (y, of_y), (x, of_x) = (
        resampler.of(int(at), NEGLIGIBLE * plan.tolerance)
        for resampler, at in zip((plan.z, plan.y, plan.x), voxel, strict=True)
    )
    carrier = plan.carrier_of(nodes.x_m[x], nodes.y_m[y, None], nodes.z_m[z, None, None])
    return (images[:, z, y, x] * carrier.conj()) @ of_x @ of_y @ of_z
