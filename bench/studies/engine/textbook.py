"""Simple implementations of backprojection, with which the engine is compared.

Each function computes the image [n], complex, at points_m [n, 3] from samples [f, t, r] of an
antenna array at frequencies_hz [f].
"""

import numba
import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.support.progress import track

BINS = 4096  # of the zero-padded range profiles: 32 times as many as there are tones
BLOCK = 512  # voxels that share a profile while it is in the cache


def numpy_sum(
    samples: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray, points_m: np.ndarray
) -> np.ndarray:
    """Backproject by the plain sum in float64, with one exponential for each point, channel and
    tone. samples [f, t, r]; points_m [n, 3]. Returns the image [n]."""
    wavenumber = 2 * np.pi * frequencies_hz[:, None, None] / SPEED_OF_LIGHT_M_S
    image = np.empty(len(points_m), np.complex128)
    for i, point in enumerate(track(points_m, "numpy")):
        to = np.linalg.norm(point - array.tx_m, axis=1)
        back = np.linalg.norm(point - array.rx_m, axis=1)
        image[i] = np.sum(samples * np.exp(1j * wavenumber * (to[:, None] + back)))
    return image


def numba_sum(
    samples: np.ndarray, frequencies_hz: np.ndarray, array: AntennaArray, points_m: np.ndarray
) -> np.ndarray:
    """Backproject by the plain sum in compiled loops on all cores, with one exponential for each
    point, channel and tone. samples [f, t, r]; points_m [n, 3]. Returns the image [n]."""
    wavenumber = 2 * np.pi * frequencies_hz / SPEED_OF_LIGHT_M_S
    return _numba_sum(samples, wavenumber, array.tx_m, array.rx_m, points_m)


@numba.njit(parallel=True, fastmath=True, cache=True)
def _numba_sum(samples, wavenumber, tx_m, rx_m, points_m):  # type: ignore[no-untyped-def]
    image = np.empty(len(points_m), np.complex128)
    for i in numba.prange(len(points_m)):
        to = np.sqrt(((points_m[i] - tx_m) ** 2).sum(axis=1))
        back = np.sqrt(((points_m[i] - rx_m) ** 2).sum(axis=1))
        re, im = 0.0, 0.0
        for f in range(len(wavenumber)):
            for t in range(len(to)):
                for r in range(len(back)):
                    phase = wavenumber[f] * (to[t] + back[r])
                    cosine, sine = np.cos(phase), np.sin(phase)
                    s = samples[f, t, r]
                    re += s.real * cosine - s.imag * sine
                    im += s.real * sine + s.imag * cosine
        image[i] = complex(re, im)
    return image


def range_compressed(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    points_m: np.ndarray,
    bins: int = BINS,
) -> np.ndarray:
    """Backproject from range profiles: a zero-padded FFT over the tones of each channel, then
    linear interpolation for each point and channel. Returns the image [n].

    samples [f, t, r]; points_m [n, 3]. bins: length of a range profile. The tones must be evenly
    spaced, and paths shorter than the unambiguous length.
    """
    tones = len(frequencies_hz)
    step_hz = (frequencies_hz[-1] - frequencies_hz[0]) / (tones - 1)
    # about the band's centre profiles vary least
    middle = np.exp(-1j * np.pi * (tones - 1) * np.arange(bins) / bins)
    profiles = np.empty((*array.channels, bins), np.complex64)
    for t in range(len(array.tx_m)):
        profiles[t] = bins * np.fft.ifft(samples[:, t].T, bins, axis=1) * middle
    wavenumber = np.pi * (frequencies_hz[0] + frequencies_hz[-1]) / SPEED_OF_LIGHT_M_S
    bins_per_m = bins * step_hz / SPEED_OF_LIGHT_M_S
    return _interpolated(profiles, wavenumber, bins_per_m, array.tx_m, array.rx_m, points_m)


@numba.njit(parallel=True, fastmath=True, cache=True)
def _interpolated(  # type: ignore[no-untyped-def]
    profiles, wavenumber, bins_per_m, tx_m, rx_m, points_m
):
    image = np.zeros(len(points_m), np.complex64)
    for block in numba.prange((len(points_m) + BLOCK - 1) // BLOCK):
        points = points_m[block * BLOCK : (block + 1) * BLOCK]
        here = image[block * BLOCK : (block + 1) * BLOCK]
        n = len(points)
        to, to_phase = _leg(tx_m, points, bins_per_m, wavenumber)
        back, back_phase = _leg(rx_m, points, bins_per_m, wavenumber)
        for t in range(len(tx_m)):
            total = np.zeros(n, np.complex64)
            for r in range(len(rx_m)):
                profile = profiles[t, r]
                for p in range(n):
                    where = to[t, p] + back[r, p]
                    k = int(where)
                    weight = np.float32(where - k)
                    value = profile[k] + weight * (profile[k + 1] - profile[k])
                    total[p] += value * back_phase[r, p]
            for p in range(n):
                here[p] += total[p] * to_phase[t, p]
    return image


@numba.njit(cache=True)
def _leg(antennas_m, points_m, bins_per_m, wavenumber):  # type: ignore[no-untyped-def]
    """Compute the distances from antennas [a, 3] to points [p, 3] in range bins, and their phase
    factors at the centre frequency; both are [a, p]."""
    distance_m = np.sqrt(((points_m - antennas_m.reshape(-1, 1, 3)) ** 2).sum(axis=2))
    return bins_per_m * distance_m, np.exp(1j * wavenumber * distance_m).astype(np.complex64)
