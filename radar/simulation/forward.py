"""The forward model of echoes: scatterers → samples, the adjoint of backprojection.

    S_f[t, r] = Σ_p w(p) g_t(p) g_r(p) exp(−j2πf(|p − t| + |p − r|)/c)

The gains g_a(p) = √max(n·û_a, 0) / |p − a|
are the spreading and obliquity between antenna a and point p with normal n: the physical-optics
integrand of a smooth surface, whose obliquity is shared evenly between transmitter and receiver, so
that it is separable and reciprocal (exact where both see the facet under the same angle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, positions
from handbench.radar.imaging.api import points_plan
from handbench.radar.imaging.cpu.adjoint import FULL_SIGHT, PackedScatterers, Sight
from handbench.radar.imaging.cpu.executor import echoes
from handbench.radar.imaging.cpu.steering import GRAZING, least_cosine, steering
from handbench.radar.imaging.tree import Box, Family, clusters
from handbench.support.errors import HandbenchError
from handbench.support.parallel import for_each

CHUNK = 2048  # scatterers per matrix product
# distance from the array, in wavelengths, within which 1/R changes by a fifth or more between
# antennas
NEAR = 5.0


@dataclass(frozen=True)
class Scatterers:
    """Points that scatter waves.

    position_m [p, 3]; weight [p]: surface area in m² for physical optics, or any amplitude for
    points; normal [p, 3]: unit vectors (None: the points scatter evenly in all directions). seen:
    masks (bool [t, p], bool [r, p]) of the transmitters and the receivers that see each point
    (None: all do); sight: complex factor of the field between each antenna and each point behind
    diffracting edges (None: 1).
    """

    position_m: np.ndarray
    weight: np.ndarray
    normal: np.ndarray | None = None
    seen: tuple[np.ndarray, np.ndarray] | None = None
    sight: Sight | None = None

    def where(self, chosen: np.ndarray) -> Scatterers:
        """Return the scatterers that a mask [p] or indices [n] select."""
        seen = None if self.seen is None else (self.seen[0][:, chosen], self.seen[1][:, chosen])
        normal = None if self.normal is None else self.normal[chosen]
        sight = None if self.sight is None else self.sight.where(chosen)
        return Scatterers(self.position_m[chosen], self.weight[chosen], normal, seen, sight)


def simulate(
    scatterers: Scatterers,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    spreading: bool = True,
    tolerance: float | None = 1e-5,
    pattern: float = 0.0,
    sight_tolerance: float = 0.0,
) -> np.ndarray:
    """Simulate noise-free samples of scatterers: complex64 [f, t, r], by tone, transmitter and
    receiver. Raises HandbenchError for invalid positions and, with spreading, for scatterers on an
    antenna.

    spreading: False leaves out the gains (decay with 1/R, obliquity and pattern), which makes this
    the exact adjoint of backprojection. pattern: exponent q of the antennas' amplitude pattern
    cosᵠθ, with θ from the z axis.

    tolerance: relative L2 error of the fast summation; None sums every scatterer at every tone.
    sight_tolerance: if larger, it is used in place of `tolerance` for scatterers that waves reach
    by diffraction.
    """
    scatterers, partly = _in_sight(scatterers)
    if len(scatterers.position_m) > 0:
        _check(scatterers, array, spreading)
    if tolerance is None:
        return _simulate_exactly(scatterers, frequencies_hz, array, spreading, pattern)
    position = np.ascontiguousarray(scatterers.position_m, np.float64)
    family = Family(tolerance, per_tone=False, pattern=pattern if spreading else None)
    kinked = partly | _bent(scatterers, frequencies_hz, array, pattern) if spreading else partly
    sight = scatterers.sight
    kind = kinked.astype(int) if sight is None else np.where(sight.partial, 2, kinked)
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
    # skeletons need smooth gains: those with a kink and those of diffraction keep all antennas
    for whole in range(3):
        of_kind = np.flatnonzero(kind == whole)
        for near in clusters(position[of_kind], frequencies_hz) if len(of_kind) else []:
            chosen = of_kind[near]
            family = family._replace(whole=whole > 0)
            if sight is not None and whole == 2:
                family = family._replace(detour_m=2 * sight.detour_m)
                if sight_tolerance > tolerance:
                    family = family._replace(
                        tolerance=sight_tolerance, whole=False, beside=sight.beside
                    )
            plan = points_plan(frequencies_hz, array, position[chosen], family)
            where = plan.sort(position[chosen])
            part = scatterers.where(chosen[where.order])
            samples += echoes(plan, _source(part, where.points_m, spreading, pattern, whole), where)
    return samples


def _in_sight(scatterers: Scatterers) -> tuple[Scatterers, np.ndarray]:
    """Leave out scatterers that no transmitter or no receiver sees: (the other scatterers, boolean
    mask that is True for those hidden from at least one antenna)."""
    if scatterers.seen is None:
        return scatterers, np.zeros(len(scatterers.position_m), bool)
    tx, rx = scatterers.seen
    some = np.logical_and(tx.any(axis=0), rx.any(axis=0))
    partly = ~np.logical_and(tx.all(axis=0), rx.all(axis=0))
    return (scatterers, partly) if some.all() else (scatterers.where(some), partly[some])


def _check(scatterers: Scatterers, array: AntennaArray, spreading: bool) -> None:
    """Raise HandbenchError for invalid positions and, with spreading, for scatterers on an antenna
    (R = 0)."""
    places_m = positions("scatterers.position_m", scatterers.position_m)
    if not spreading:
        return
    antennas_m = np.concatenate([array.tx_m, array.rx_m])
    among = (places_m >= antennas_m.min(axis=0)) & (places_m <= antennas_m.max(axis=0))
    inside = np.flatnonzero(among.all(axis=1))
    on = inside[cKDTree(antennas_m).query(places_m[inside])[0] == 0]
    if len(on) > 0:
        raise HandbenchError(
            f"scatterers.position_m: point {on[0]} at {places_m[on[0]].tolist()} is on an "
            "antenna, where its echo is infinite; move or remove it, or simulate without spreading"
        )


def _source(
    part: Scatterers, points_m: np.ndarray, spreading: bool, pattern: float, whole: int
) -> PackedScatterers:
    """Pack scatterers into arrays for compiled code. points_m [3, p]: their positions; whole: 1 to
    apply the masks `seen`, 2 to apply the factors `sight`, 0 for neither."""
    normal = (
        np.zeros((3, 0)) if part.normal is None else np.ascontiguousarray(part.normal.T, np.float64)
    )
    everyone = np.zeros((0, 0), np.uint8)
    seen = part.seen if whole == 1 and part.seen is not None else (everyone, everyone)
    seen_tx, seen_rx = (np.ascontiguousarray(leg, np.uint8) for leg in seen)
    weight = np.asarray(part.weight, np.complex64)
    sight = part.sight if whole == 2 and part.sight is not None else FULL_SIGHT
    return PackedScatterers(
        points_m, weight, normal, spreading, float(pattern), seen_tx, seen_rx, sight
    )


def _bent(
    scatterers: Scatterers, frequencies_hz: np.ndarray, array: AntennaArray, pattern: float
) -> np.ndarray:
    """Return True for the points [p] whose gain is not smooth over the box around all antennas, so
    that it cannot be interpolated between antennas.

    These are points close to the array, facets that some corner of the box sees at a grazing angle
    or from behind, and points far off the axis of the antennas' pattern.
    """
    antennas = np.concatenate([array.tx_m, array.rx_m])
    box = Box(antennas.min(axis=0), antennas.max(axis=0))
    beside_m = scatterers.position_m - np.clip(scatterers.position_m, *box)
    bent = np.linalg.norm(beside_m, axis=1) < NEAR * SPEED_OF_LIGHT_M_S / np.min(frequencies_hz)
    if scatterers.normal is None and pattern == 0:
        return bent
    least, most, ahead = (
        np.full(len(bent), np.inf),
        np.full(len(bent), -np.inf),
        np.full(len(bent), np.inf),
    )
    for corner_m in np.unique(box.corners_m, axis=0):
        towards = corner_m - scatterers.position_m
        distance = np.sqrt(np.einsum("pi,pi->p", towards, towards))
        ahead = np.minimum(ahead, -towards[:, 2] / distance)
        if scatterers.normal is not None:
            cosine = np.einsum("pi,pi->p", towards, scatterers.normal) / distance
            least, most = np.minimum(least, cosine), np.maximum(most, cosine)
    bent |= (least < GRAZING) & (most > 0)
    return bent | (ahead < least_cosine(pattern)) if pattern != 0 else bent


def _simulate_exactly(
    scatterers: Scatterers,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    spreading: bool,
    pattern: float,
) -> np.ndarray:
    position = np.ascontiguousarray(scatterers.position_m, np.float64)
    antennas = [leg.position_m for leg in array.legs]
    gains = [np.ones((len(leg_m), len(position)), np.float32) for leg_m in antennas]
    if spreading:
        gains = [_gain(position, scatterers.normal, leg_m, pattern) for leg_m in antennas]
    if scatterers.seen is not None:
        gains = [gain * seen for gain, seen in zip(gains, scatterers.seen, strict=True)]
    gains[0] = gains[0] * np.asarray(scatterers.weight, np.complex64)
    distances = [np.linalg.norm(position[None] - leg_m[:, None], axis=2) for leg_m in antennas]
    legs = list(zip(distances, gains, strict=True))
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)

    def work(f: int) -> None:
        turns_per_m = frequencies_hz[f] / SPEED_OF_LIGHT_M_S
        total = np.zeros(array.channels, np.complex128)
        for start in range(0, len(position), CHUNK):
            chunk = slice(start, start + CHUNK)
            a, b = (_conjugate_steering(d[:, chunk], g[:, chunk], turns_per_m) for d, g in legs)
            if scatterers.sight is not None:
                here = scatterers.sight.where(np.arange(len(position))[chunk])
                a, b = (wave * here.weights(leg, turns_per_m) for leg, wave in enumerate((a, b)))
            total += a @ b.T
        samples[f] = total

    for_each(work, range(len(samples)))
    return samples


def _gain(
    points_m: np.ndarray, normal: np.ndarray | None, antennas_m: np.ndarray, pattern: float
) -> np.ndarray:
    """Compute the amplitude gains between antennas and points: float32 [a, p]. They are 1/R, times
    √(n·û) (obliquity) if the points have normals, times cosᵠθ (the antennas' pattern, exponent q =
    `pattern`)."""
    gains = np.empty((len(antennas_m), len(points_m)), np.float32)
    for gain, antenna in zip(gains, antennas_m, strict=True):
        towards = antenna - points_m
        distance = np.linalg.norm(towards, axis=1)
        obliquity = (
            1.0 if normal is None else np.maximum((normal * towards).sum(axis=1) / distance, 0.0)
        )
        gain[:] = np.sqrt(obliquity) / distance
        if pattern != 0:
            gain *= np.maximum(-towards[:, 2] / distance, 0.0) ** pattern
    return gains


def _conjugate_steering(distance_m: np.ndarray, gain: np.ndarray, turns_per_m: float) -> np.ndarray:
    parts = np.empty((2, *distance_m.shape), np.float32)
    steering(distance_m, turns_per_m, parts.reshape(-1, distance_m.shape[1]))
    return np.asarray(gain * (parts[0] - np.complex64(1j) * parts[1]))
