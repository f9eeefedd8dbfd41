"""Certificates: upper bounds of an image's relative error, measured at some of its voxels by exact
sums in float64.

The tolerance of imaging holds for echoes that are no worse than white noise. Echoes with a weak
image (leakage, a target outside the box, adversarial data) can exceed it, and a bound that holds
for all echoes is far too loose for given ones (Cauchy–Schwarz: |error at p| ≤ ‖u(p) − ũ(p)‖
‖samples‖, u(p) the steering vector and ũ(p) the one that fast imaging uses). A certificate
therefore tests the image itself: it compares a few voxels with the float64 sum over every tone and
antenna. Half of the voxels are drawn uniformly, half with a probability proportional to their
power; importance weights make their mean squared error an unbiased estimate of the whole image's.
The volume of a projection is not stored, so its drawn voxels are interpolated again from the coarse
grid; the arithmetic of the fast interpolation is covered by tests, not by the certificate.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import AntennaArray, Aperture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.cpu.exact import check_samples, exact_sums
from handbench.radar.imaging.device import Array, to_host
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
    """A measured bound of the error of all images made in a `certified` block.

    bound: upper bound of the relative L2 error of the worst of these images; images: their number.
    """

    bound: float = 0.0
    images: int = 0

    def add(
        self, error: np.ndarray, weight: np.ndarray, mean_square: np.ndarray, factor: float
    ) -> None:
        """Count one more image, and raise `bound` to this image's bound if that is larger.

        error [f or 1, n]: complex errors at n compared voxels; weight [n]: their importance
        weights, so that the weighted mean square error estimates that of all voxels; mean_square [f
        or 1]: mean |image|² over all voxels; factor: safety factor on the estimated relative error,
        because only few voxels are compared.
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
) -> float:
    """Estimate the relative L2 error of a volume [nz, ny, nx] from `count` random voxels.

    The error is the root mean square of the differences between these voxels and exact float64
    sums, divided by the root mean square of the whole volume. samples: the echoes that were imaged,
    complex [f, t, r] or [f, n].
    """
    check_samples(samples, frequencies_hz, aperture)
    picked = np.random.default_rng(0).integers(0, image.size, count)
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
    """Compare some pixels of images [f or 1, rows, n] with exact sums, and add their error to the
    certificate of the surrounding `certified` block. Outside such a block, do nothing.

    samples: the echoes that were imaged; points_at_m: function from flat indices [k] of an image to
    the points [k, 3] there, in metres.
    """
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
    images: Array,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
) -> None:
    """Compare some voxels of a grid with exact sums, and add their error to the certificate of the
    surrounding `certified` block. Outside such a block, do nothing.

    The voxels are interpolated from `images` [f or 1, nz, ny, nx], which were computed at the
    coarse grid `nodes` of the plan.
    """
    if (certificate := _opened.get()) is None:
        return
    images = to_host(images)
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
    """The power of images [f or 1, rows, n], by which pixels are drawn at random.

    rows [rows], counts [n]: the pixel at row i, column j represents rows[i] × counts[j] voxels.
    largest: largest absolute real or imaginary part. The power of each row, of_rows [f or 1, rows],
    and the result of `along` are in units of largest², so that float32 can hold them.
    """

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
        """Return the mean |O|² of each image O over all voxels that its pixels represent: [f or
        1]."""
        return self.of_rows @ self.rows / self.voxels * self.largest**2

    def along(self, row: np.ndarray) -> np.ndarray:
        """Return the power of all pixels of the rows with indices `row` [k], summed over the
        images, in units of `largest`²: [k, n]."""
        return (np.abs(self.images[:, row] / self.largest).astype(np.float64) ** 2).sum(axis=0)


def draw_places(bright: ImagePower, count: int) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Draw `count` pixels of images at random, half of them uniformly over the voxels that the
    pixels represent, half in proportion to power: ((row indices, column indices), weights), each
    [count].

    The expected value of the weighted mean of a quantity over the drawn pixels is the mean of this
    quantity over all voxels. The same images always give the same pixels.
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
    """Leave out the antennas whose samples are all zero: (samples, aperture) of the others.

    The image is the same and its exact sum cheaper, so that more voxels can be compared.
    """
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
    """Interpolate the image without its carrier (a fast phase that is the same for all tones) at
    one voxel, indices [3] (z, y, x), from the images at the coarse nodes around it: [f or 1]."""
    (z, of_z), (y, of_y), (x, of_x) = (
        resampler.of(int(at), NEGLIGIBLE * plan.tolerance)
        for resampler, at in zip((plan.z, plan.y, plan.x), voxel, strict=True)
    )
    carrier = plan.carrier_of(nodes.x_m[x], nodes.y_m[y, None], nodes.z_m[z, None, None])
    return (images[:, z, y, x] * carrier.conj()) @ of_x @ of_y @ of_z
