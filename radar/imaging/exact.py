"""Exact backprojection on the processor: samples → complex image at any points.

    O(p) = Σ_f Σ_t Σ_r S_f[t, r] exp(+j2πf(|p − t| + |p − r|)/c)

The double sum over antennas is a bilinear form aᵀ S b, so that one matrix product per tone and
block of points replaces t·r exponentials per point. `image_points_exact` is the same formula in
plain numpy, the reference that every faster implementation is compared with.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.distance import cdist

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    AntennaArray,
    Aperture,
    array_legs,
    channel_ends,
)
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.steering import cis_turns, steering
from handbench.support.compiled import FAST, njit
from handbench.support.parallel import for_each

BLOCK = 256  # points per matrix product: both factors stay in the second-level cache


def exact_images(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    per_tone: bool,
) -> np.ndarray:
    """Image points_m [n, 3], in metres, by the sum over every tone and antenna in float32:
    complex64 [f, n], one image per tone, with `per_tone`; else [1, n], their coherent sum.

    samples: [f, t, r] for an AntennaArray, [f, n] for AntennaPairs; frequencies_hz: [f].
    """
    images = np.zeros((len(samples) if per_tone else 1, len(points_m)), np.complex64)
    stacked = [_stack(s) for s in samples]

    def work(start: int) -> None:
        block = slice(start, start + BLOCK)
        for f, image in enumerate(
            _block_images(stacked, frequencies_hz, aperture, points_m[block])
        ):
            if per_tone:
                images[f, block] = image
            else:
                images[0, block] += image

    for_each(work, range(0, len(points_m), BLOCK))
    return images


def path_lengths(aperture: Aperture, point_m: np.ndarray) -> np.ndarray:
    """Compute the length of every channel's path, from the transmitter to a point [3] and on to the
    receiver, metres: [t, r], or [n] for a scan."""
    to, back = array_legs(aperture, (leg.lengths_m(point_m) for leg in aperture.legs))
    return (to[:, None] + back).reshape(aperture.channels)


def _block_images(
    stacked: list[np.ndarray], frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray
) -> Iterator[np.ndarray]:
    """Yield the image of every tone in turn, complex64 [n], at points_m [n, 3]. The points are few
    enough that the factors of the matrix product stay in the cache. stacked: each tone's samples as
    a real matrix, from `_stack`."""
    if not isinstance(aperture, AntennaArray):
        # the second is not looked at where the first is met twice
        to, back = (leg.position_m for leg in aperture.legs)
        points = np.ascontiguousarray(points_m.T, np.float64)
        for s, frequency_hz in zip(stacked, frequencies_hz, strict=True):
            yield _scan_image(
                s, to, back, aperture.legs[0].passes == 2, points, frequency_hz / SPEED_OF_LIGHT_M_S
            )
        return
    # once for all tones
    to, back = (cdist(leg.position_m, points_m) for leg in aperture.legs)
    a, u = (np.empty((2 * len(to), len(points_m)), np.float32) for _ in range(2))
    b = np.empty((2 * len(back), len(points_m)), np.float32)
    for s, frequency_hz in zip(stacked, frequencies_hz, strict=True):
        steering(to, frequency_hz / SPEED_OF_LIGHT_M_S, a)
        steering(back, frequency_hz / SPEED_OF_LIGHT_M_S, b)
        yield _contract(a, np.matmul(s, b, out=u))  # Σ_t a[t] (S b)[t]


def _stack(samples: np.ndarray) -> np.ndarray:
    """Convert complex samples S [t, r] to the real matrix [[Re, −Im], [Im, Re]], float32, since
    real products are faster than complex ones here. Samples [n] of a scan stay complex."""
    if samples.ndim == 1:
        return np.ascontiguousarray(samples, np.complex64)
    re, im = samples.real, samples.imag
    return np.ascontiguousarray(np.block([[re, -im], [im, re]]), dtype=np.float32)


def _contract(a: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return Σ_t a_t u_t [n], complex64, of factors [2t, n] with real parts above imaginary
    parts."""
    (a_re, a_im), (u_re, u_im) = np.split(a, 2), np.split(u, 2)
    im = (a_re * u_im + a_im * u_re).sum(axis=0)
    return np.asarray((a_re * u_re - a_im * u_im).sum(axis=0) + np.complex64(1j) * im)


@njit(**FAST)
def _scan_image(  # type: ignore[no-untyped-def]
    samples, tx_m, rx_m, there_and_back, points_m, turns_per_m
):
    n = points_m.shape[1]
    re, im = np.zeros(n, np.float64), np.zeros(n, np.float64)
    for a in range(len(tx_m)):
        s_re, s_im = samples[a].real, samples[a].imag
        for p in range(n):
            x, y, z = points_m[0, p], points_m[1, p], points_m[2, p]
            dx, dy, dz = x - tx_m[a, 0], y - tx_m[a, 1], z - tx_m[a, 2]
            to = back = math.sqrt(dx * dx + dy * dy + dz * dz)
            if not there_and_back:
                dx, dy, dz = x - rx_m[a, 0], y - rx_m[a, 1], z - rx_m[a, 2]
                back = math.sqrt(dx * dx + dy * dy + dz * dz)
            cosine, sine = cis_turns(turns_per_m * (to + back))
            re[p] += s_re * cosine - s_im * sine
            im[p] += s_re * sine + s_im * cosine
    return (re + 1j * im).astype(np.complex64)


def image_points_exact(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    transmitters_m: np.ndarray,
    receivers_m: np.ndarray,
    points_m: np.ndarray,
) -> np.ndarray:
    """Compute the image O(p) = Σ_f Σ_t Σ_r S_f[t, r] exp(+j2πf(|p − t| + |p − r|)/c) at points p:
    complex128 [p].

    samples: S, complex [f, t, r] for tones, transmitters and receivers, or [f, n] if receiver i
    receives only from transmitter i; frequencies_hz: [f]; transmitters_m [t, 3], receivers_m [r, 3]
    and points_m [p, 3]: positions in metres. Raises ValueError if the shapes do not fit.
    """
    ends_m = (transmitters_m, receivers_m)
    to_m, back_m = (np.linalg.norm(points_m - end_m[:, None], axis=2) for end_m in ends_m)
    image = np.zeros(len(points_m), np.complex128)
    for s, f in zip(samples, frequencies_hz, strict=True):
        to, back = (np.exp(2j * np.pi * f * r_m / SPEED_OF_LIGHT_M_S) for r_m in (to_m, back_m))
        image += s @ (to * back) if s.ndim == 1 else ((s.T @ to) * back).sum(axis=0)
    return image


def imaging_error(
    image: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    count: int = 500,
) -> float:
    """Estimate the relative L2 error √(mean |I(p) − O(p)|² / mean |I|²) of a volume I [nz, ny, nx]
    from its exact sums O at `count` random voxels p.

    samples: the echoes that were imaged, complex [f, t, r], or [f, n] of a scan; grid: the voxels.
    """
    picked = np.random.default_rng(0).integers(0, image.size, count)
    ends_m = (
        (aperture.tx_m, aperture.rx_m)
        if isinstance(aperture, AntennaArray)
        else channel_ends(aperture)
    )
    exact = image_points_exact(samples, frequencies_hz, *ends_m, grid.points_at_m(picked))
    error, size = image.ravel()[picked] - exact, np.mean(np.abs(image) ** 2, dtype=np.float64)
    return float(np.sqrt(np.divide(np.mean(np.abs(error) ** 2), size)))
