"""The forward model: scatterers → samples, the adjoint of backprojection.

    S_f[t, r] = Σ_p w(p) g_t(p) g_r(p) exp(−j2πf(|p − t| + |p − r| + 2δ(p))/c)

with an optional one-way delay δ (foam) and the spreading and obliquity of each leg, g_a(p) = √max(n·û_a, 0) / |p − a|:
the physical-optics integrand of a smooth surface, whose obliquity is shared evenly by both legs so that it stays
separable and reciprocal (exact where transmitter and receiver see the facet under the same angle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from radar.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture
from radar.backprojection import path_lengths
from radar.imaging import points_engine
from radar.leaf import Source
from radar.parallel import for_each
from radar.steering import cis_turns
from radar.tree import Box, Family, clusters

CHUNK = 2048  # scatterers per matrix product
GRAZING = 0.05  # cosine below which √(n·û) bends too sharply across the array


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
    tolerance: float | None = 1e-5,
) -> np.ndarray:
    """Noise-free samples complex64 [f, t, r]. spreading=False leaves out g: the exact adjoint of backprojection.

    tolerance: relative L2 error of the fast chain (see `radar.imaging`); None sums every tone of every scatterer.
    """
    position = np.ascontiguousarray(scatterers.position_m, np.float64)
    delay = np.zeros(len(position)) if scatterers.delay_m is None else np.asarray(scatterers.delay_m, np.float64)
    if tolerance is None:
        return _simulate_exactly(scatterers, position, delay, frequencies_hz, array, spreading)
    family = Family(tolerance, apart=False, delay_m=2 * delay.max(initial=0.0))
    grazing = _grazing(scatterers, array) if spreading else np.zeros(len(position), bool)
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
    for whole in (False, True):  # an obliquity with a kink is not smooth enough to be carried by few antennas
        alike = np.flatnonzero(grazing == whole)
        for near in clusters(position[alike], frequencies_hz) if len(alike) else []:
            chosen = alike[near]
            engine = points_engine(frequencies_hz, array, position[chosen], family._replace(whole=whole))
            where = engine.sort(position[chosen])
            chosen = chosen[where.order]
            normal = np.zeros((3, 0)) if scatterers.normal is None else scatterers.normal[chosen].T
            weight = np.asarray(scatterers.weight, np.complex64)[chosen]
            source = Source(where.points_m, weight, delay[chosen], np.ascontiguousarray(normal, np.float64), spreading)
            samples += engine.echoes(source, where)
    return samples


def _grazing(scatterers: Scatterers, array: AntennaArray) -> np.ndarray:
    """Which facets [p] some antenna sees at grazing incidence or from behind, from the corners of the array's box."""
    if scatterers.normal is None:
        return np.zeros(len(scatterers.position_m), bool)
    antennas = np.concatenate([array.tx_m, array.rx_m])
    towards = Box(antennas.min(axis=0), antennas.max(axis=0)).corners_m - scatterers.position_m[:, None]
    cosine = np.einsum("pci,pi->pc", towards, scatterers.normal) / np.linalg.norm(towards, axis=2)
    return (cosine.min(axis=1) < GRAZING) & (cosine.max(axis=1) > 0)


def direct_echoes(
    position_m: np.ndarray, weight: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Echoes without spreading by the formula as it stands, in float64: complex128 [f, t, r] or [f, n]. The adjoint of
    `direct_sum`, and the reference of every faster path."""
    samples = np.zeros((len(frequencies_hz), *aperture.channels), np.complex128)
    for point, w in zip(np.asarray(position_m, np.float64), weight, strict=True):
        path_m = path_lengths(aperture, point)
        for sample, f in zip(samples, frequencies_hz, strict=True):
            sample += w * np.exp(-2j * np.pi * f * path_m / SPEED_OF_LIGHT_M_S)
    return samples


def _simulate_exactly(
    scatterers: Scatterers,
    position: np.ndarray,
    delay: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    spreading: bool,
) -> np.ndarray:
    antennas = [leg.position_m for leg in array.legs]
    gains = [
        _gain(position, scatterers.normal, legs) if spreading else np.ones((len(legs), len(position)), np.float32)
        for legs in antennas
    ]
    gains[0] = gains[0] * np.asarray(scatterers.weight, np.float32)
    distances = [np.linalg.norm(position[None] - legs[:, None], axis=2) + delay for legs in antennas]
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)

    def work(f: int) -> None:
        turns_per_m = frequencies_hz[f] / SPEED_OF_LIGHT_M_S
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
    return samples


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
