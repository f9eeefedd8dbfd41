"""The forward model: scatterers → samples, the adjoint of backprojection.

    S_f[t, r] = Σ_p w(p) g_t(p) g_r(p) exp(−j2πf(|p − t| + |p − r| + 2δ(p))/c)

with an optional one-way delay δ (foam) and the spreading and obliquity of each leg, g_a(p) = √max(n·û_a, 0) / |p − a|:
the physical-optics integrand of a smooth surface, whose obliquity is shared evenly by both legs so that it stays
separable and reciprocal (exact where transmitter and receiver see the facet under the same angle).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numba
import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.parallel import for_each
from radar.steering import cis_turns
from radar.tones import ToneSkeleton, distances_m

CHUNK = 2048  # scatterers per matrix product


@dataclass(frozen=True)
class Scatterers:
    """position_m [p, 3]; weight [p] (surface area in m² for physical optics, any amplitude for points); normal [p, 3]
    unit vectors, or None for points that scatter evenly; delay_m [p] extra one-way optical path, or None."""

    position_m: np.ndarray
    weight: np.ndarray
    normal: np.ndarray | None = None
    delay_m: np.ndarray | None = None


def simulate(
    scatterers: Scatterers,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    spreading: bool = True,
    tolerance: float | None = 1e-6,
) -> np.ndarray:
    """Noise-free samples complex64 [f, t, r]. spreading=False leaves out g: the exact adjoint of backprojection.

    tolerance: of the tone skeleton over the scatterers' box (see `radar.tones`); None sums every tone.
    """
    position = np.ascontiguousarray(scatterers.position_m, np.float64)
    delay = np.zeros(len(position)) if scatterers.delay_m is None else np.asarray(scatterers.delay_m, np.float64)
    gains = [
        _gain(position, scatterers.normal, legs) if spreading else np.ones((len(legs), len(position)), np.float32)
        for legs in array.legs_m
    ]
    gains[0] = gains[0] * np.asarray(scatterers.weight, np.float32)
    distances = [distances_m(position.T, legs) + delay for legs in array.legs_m]
    margin = delay.max(initial=0.0)  # a delay makes the box that much deeper
    corners = np.array(list(product(*zip(position.min(axis=0) - margin, position.max(axis=0) + margin, strict=True))))
    tones = ToneSkeleton(frequencies_hz, array, corners.T, tolerance)
    samples = np.zeros((len(tones.frequencies_hz), *array.channels), np.complex64)

    def work(f: int) -> None:
        turns_per_m = tones.frequencies_hz[f] / SPEED_OF_LIGHT_M_S
        total = np.zeros(array.channels, np.complex128)
        for start in range(0, len(position), CHUNK):
            chunk = slice(start, start + CHUNK)
            a, b = (
                _conjugate_steering(d[:, chunk], g[:, chunk], turns_per_m)
                for d, g in zip(distances, gains, strict=True)
            )
            total += a @ b.T
        samples[f] = total

    for_each(work, range(len(samples)))
    return tones.expand(samples)


def _gain(points_m: np.ndarray, normal: np.ndarray | None, antennas_m: np.ndarray) -> np.ndarray:
    """g [a, p]: 1/R, times the square root of the obliquity n·û where the scatterers have normals."""
    gains = np.empty((len(antennas_m), len(points_m)), np.float32)
    for gain, antenna in zip(gains, antennas_m, strict=True):
        towards = antenna - points_m
        distance = np.linalg.norm(towards, axis=1)
        obliquity = 1.0 if normal is None else np.maximum((normal * towards).sum(axis=1) / distance, 0.0)
        gain[:] = np.sqrt(obliquity) / distance
    return gains


@numba.njit(nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy")
def _conjugate_steering(distance_m, gain, turns_per_m):  # type: ignore[no-untyped-def]
    out = np.empty(distance_m.shape, np.complex64)
    for a in range(distance_m.shape[0]):
        for p in range(distance_m.shape[1]):
            cosine, sine = cis_turns(turns_per_m * distance_m[a, p])
            out[a, p] = gain[a, p] * (cosine - np.complex64(1j) * sine)
    return out
