"""The forward model of echoes: scatterers → samples, the adjoint of backprojection; and both as one
linear operator of SciPy.

    S_f[t, r] = Σ_p w(p) g_t(p) g_r(p) exp(−j2πf(|p − t| + |p − r|)/c)

The gains g_a(p) = D_a(p) √max(n·û_a, 0) / |p − a|
are the shadow, the obliquity and the spreading between antenna a and point p with normal n: the
physical-optics integrand of a smooth surface, whose obliquity is shared evenly between transmitter
and receiver, so that it is separable and reciprocal (exact where both see the facet under the same
angle).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, positions, tones
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import check, image_points, image_volume, points_plan
from handbench.radar.imaging.cpu import echoes
from handbench.radar.imaging.steering import GRAZING, least_cosine, steering
from handbench.radar.imaging.tree import Box, Family, clusters
from handbench.support.errors import HandbenchError
from handbench.support.parallel import for_each

CHUNK = 2048  # scatterers per matrix product
# distance from the array, in wavelengths, within which 1/R changes by a fifth or more between
# antennas
NEAR = 5.0


@dataclass(frozen=True)
class Sight:
    """The complex factor D by which obstacles change the wave between each antenna and each of p
    points: 1 in full sight, 0 in full shadow, and in between, near shadow edges, the result of
    diffraction. D is smooth over points, antennas and frequency, and tabulated at few of each.

    corner [p, 3]: the three samples around each point (−1: the point is in full sight of all
    antennas), whose entries in the tables are interpolated with barycentric weights share [p, 3].
    For transmitters and receivers: tables [samples, 3, nodes], complex64, coefficients of 1, u and
    u², u = (f/c − middle) / half, at some antennas (nodes), and spreads [a, nodes], float32, which
    interpolate these to all. detour_m: longest extra path of diffracted waves; beside: sine of the
    largest angle between them and the straight ray.
    """

    corner: np.ndarray
    share: np.ndarray
    tables: tuple[np.ndarray, np.ndarray]
    spreads: tuple[np.ndarray, np.ndarray]
    middle: float = 0.0
    half: float = 1.0
    detour_m: float = 0.0
    beside: float = 0.0

    def __getitem__(self, chosen: np.ndarray | slice) -> Sight:
        """Return the factors at the points that a mask, indices or a slice select."""
        return replace(self, corner=self.corner[chosen], share=self.share[chosen])

    @property
    def partial(self) -> np.ndarray:
        """Boolean mask [p]: True for points that are not in full sight of all antennas."""
        return self.corner[:, 0] >= 0

    def factors(self, leg: int, antennas: np.ndarray, turns_per_m: np.ndarray) -> np.ndarray:
        """Compute D between the transmitters (leg 0) or receivers (leg 1) with these indices [a]
        and all points, at turns_per_m = f/c [k]: float32 [k, 2, a, p], real and imaginary part."""
        rows = self.tables[leg].reshape(len(self.tables[leg]), -1).view(np.float32)
        mixed = self.share[:, 0, None] * rows[self.corner[:, 0]]
        for i in (1, 2):
            mixed += self.share[:, i, None] * rows[self.corner[:, i]]
        at_nodes = np.ascontiguousarray(mixed.T).reshape(3, -1, 2, len(mixed)).swapaxes(1, 2)
        at_antennas = self.spreads[leg][antennas] @ at_nodes
        u = (turns_per_m - self.middle) / self.half
        powers = (u[:, None] ** np.arange(3)).astype(np.float32)
        factors = (powers @ at_antennas.reshape(3, -1)).reshape(len(u), *at_antennas.shape[1:])
        if not self.partial.all():
            factors[..., ~self.partial] = np.array([1, 0])[:, None, None]
        return np.asarray(factors)


@dataclass(frozen=True)
class Scatterers:
    """Points that scatter waves, such as the facets of a surface.

    position_m [p, 3]; weight [p]: surface area in m² for physical optics, or any amplitude for
    points; normal [p, 3]: unit vectors (None: the points scatter evenly in all directions); sight:
    complex factors of the fields between antennas and points (None: 1). Of facets: face [p], index
    of the mesh's face that each is a part of, and share [p, 3], barycentric coordinates between
    this face's corners.
    """

    position_m: np.ndarray
    weight: np.ndarray
    normal: np.ndarray | None = None
    sight: Sight | None = None
    face: np.ndarray | None = None
    share: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.weight)

    def where(self, chosen: np.ndarray | slice) -> Scatterers:
        """Return the scatterers that a mask [p], indices [n] or a slice select."""
        given = {name: value[chosen] for name, value in vars(self).items() if value is not None}
        return replace(self, **given)


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
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
    if len(scatterers) == 0:
        return samples
    _check(scatterers, array, spreading)
    exponent, legs_m = pattern if spreading else None, (array.tx_m, array.rx_m)
    if tolerance is None:
        chunks = [slice(at, at + CHUNK) for at in range(0, len(scatterers), CHUNK)]
        parts = (scatterers.where(chunk) for chunk in chunks)
        sums = (_simulate_exactly(part, frequencies_hz, array, exponent) for part in parts)
        return sum(sums, samples.astype(np.complex128)).astype(np.complex64)
    position = np.ascontiguousarray(scatterers.position_m, np.float64)
    family = Family(tolerance, per_tone=False, pattern=exponent)
    kind = np.zeros(len(position), int)  # 0: smooth gains, for which few antennas are enough,
    if spreading:
        kind[_bent(scatterers, frequencies_hz, array, pattern)] = 1  # 1: gains with a kink
    families = [family, family._replace(whole=True)]
    if (sight := scatterers.sight) is not None:
        kind[sight.partial] = 2  # 2: diffraction
        families += [family._replace(detour_m=2 * sight.detour_m, whole=True)]
        if sight_tolerance > tolerance:
            families[2] = families[2]._replace(
                tolerance=sight_tolerance, whole=False, beside=sight.beside
            )
    for number, family in enumerate(families):
        of_kind = np.flatnonzero(kind == number)
        for near in clusters(position[of_kind], frequencies_hz) if len(of_kind) else []:
            chosen = of_kind[near]
            plan = points_plan(frequencies_hz, array, position[chosen], family)
            where = plan.sort(position[chosen])
            part = scatterers.where(chosen[where.order])
            if number < 2:
                part = replace(part, sight=None)
            gains = partial(_gains, part, legs_m, exponent)
            samples += echoes(plan, gains, where)
    return samples


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
    hidden, seen = np.zeros((2, len(bent)), bool)
    for corner_m in np.unique(box.corners_m, axis=0):
        towards = corner_m - scatterers.position_m
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        if pattern != 0:
            bent |= -towards[:, 2] < least_cosine(pattern)
        if scatterers.normal is not None:
            cosine = np.einsum("pi,pi->p", towards, scatterers.normal)
            hidden |= cosine < GRAZING
            seen |= cosine > 0
    return bent | (hidden & seen)


def _gains(
    scatterers: Scatterers,
    legs_m: tuple[np.ndarray, np.ndarray],
    pattern: float | None,
    here: slice,
    antennas: tuple[np.ndarray, np.ndarray],
    distances_m: list[np.ndarray],
    turns_per_m: np.ndarray,
) -> list[np.ndarray]:
    """Compute the gains g_a(p) of the transmitters and of the receivers with the indices `antennas`
    at the scatterers `here`, times their weights for the transmitters: float32 [k, 2, a, p], real
    and imaginary part, at turns_per_m = f/c [k], or [1, 2, a, p] if they are the same for all
    tones. distances_m: of both, [a, p]; pattern: as in `_gain`."""
    part, gains = scatterers.where(here), []
    for leg, (number, distance_m) in enumerate(zip(antennas, distances_m, strict=True)):
        gain = _gain(part, legs_m[leg][number], distance_m, pattern)
        weight = np.asarray(part.weight if leg == 0 else [1], np.complex64)
        if part.sight is None:
            gains.append((gain * np.stack([weight.real, weight.imag])[:, None])[None])
        else:  # of facets, whose weights are areas
            gains.append(gain * weight.real * part.sight.factors(leg, number, turns_per_m))
    return gains


def _gain(
    scatterers: Scatterers, antennas_m: np.ndarray, distance_m: np.ndarray, pattern: float | None
) -> np.ndarray:
    """Compute the gains of antennas at scatterers without D, float32 [a, p]: 1/R with R =
    distance_m, times √(n·û) (obliquity) if they have normals, times cosᵠθ, the antennas' pattern
    with the exponent q = `pattern`. With None, all gains are 1."""
    if pattern is None:
        return np.ones((len(antennas_m), len(scatterers)), np.float32)
    points_m, normal = scatterers.position_m, scatterers.normal
    gain = nearness = 1 / distance_m.astype(np.float32)
    if normal is not None:
        towards_m = antennas_m @ normal.T - np.einsum("pi,pi->p", points_m, normal)
        gain = np.sqrt(np.maximum(towards_m.astype(np.float32) * nearness, 0)) * gain
    if pattern != 0:
        ahead_m = points_m[:, 2] - antennas_m[:, 2, None]
        gain = np.maximum(ahead_m.astype(np.float32) * nearness, 0) ** np.float32(pattern) * gain
    return np.asarray(gain)


def _simulate_exactly(
    scatterers: Scatterers, frequencies_hz: np.ndarray, array: AntennaArray, pattern: float | None
) -> np.ndarray:
    """Sum the echoes of every scatterer at every tone: complex64 [f, t, r]."""
    legs_m = [leg.position_m for leg in array.legs]
    lengths_m = [cdist(leg_m, scatterers.position_m) for leg_m in legs_m]
    gains = [
        _gain(scatterers, leg_m, length_m, pattern).astype(np.complex64)
        for leg_m, length_m in zip(legs_m, lengths_m, strict=True)
    ]
    gains[0] *= np.asarray(scatterers.weight, np.complex64)
    samples = np.empty((len(frequencies_hz), *array.channels), np.complex64)

    def work(f: int) -> None:
        turns_per_m, waves = frequencies_hz[f] / SPEED_OF_LIGHT_M_S, []
        for leg, (length_m, gain) in enumerate(zip(lengths_m, gains, strict=True)):
            parts = np.empty((2, *length_m.shape), np.float32)
            steering(length_m, turns_per_m, parts.reshape(-1, length_m.shape[1]))
            wave = gain * (parts[0] - np.complex64(1j) * parts[1])
            if scatterers.sight is not None:
                every = np.arange(len(wave))
                re, im = scatterers.sight.factors(leg, every, np.array([turns_per_m]))[0]
                wave *= re + np.complex64(1j) * im
            waves.append(wave)
        samples[f] = waves[0] @ waves[1].T

    for_each(work, range(len(samples)))
    return samples


def operator(
    array: AntennaArray,
    frequencies_hz: ArrayLike,
    grid: VoxelGrid | ArrayLike,
    tolerance: float | None = 1e-3,
) -> LinearOperator:
    """Return the linear model of echoes A and its adjoint, for solvers such as SciPy's `lsqr`:

        (A x)(f, t, r) = Σ_p x(p) exp(−j2πf(|p − t| + |p − r|)/c)
        (Aᴴ y)(p) = Σ_{f,t,r} y(f, t, r) exp(+j2πf(|p − t| + |p − r|)/c), which is backprojection

    Args:
        array: the antennas t and r, as `capture.echoes.aperture`.
        frequencies_hz: the tones f.
        grid: the points p, a `VoxelGrid` or positions [n, 3] in the radar's frame, metres.
        tolerance: largest relative L2 error of both products, 1e-6 to 0.1; None: exact sums.

    Returns:
        SciPy's LinearOperator, complex64: a row per sample in the order f, t, r, 0 for pairs that
        were not measured; a column per voxel in the order z, y, x, or per point.

    Raises:
        HandbenchError: a scan instead of an array, or an invalid argument.
    """
    check(tolerance)
    tones_hz = tones("frequencies_hz", frequencies_hz)
    if not isinstance(array, AntennaArray):
        raise HandbenchError(
            f"array: is an {type(array).__name__}; expected an AntennaArray, since echoes are "
            "simulated for every transmitter with every receiver"
        )
    if isinstance(grid, VoxelGrid):
        points_m = grid.points_m().reshape(-1, 3)
        image = partial(image_volume, grid=grid)
    else:
        points_m = positions("grid", grid)
        image = partial(image_points, points_m=points_m)
    shape = len(tones_hz), *array.channels
    measured = True if array.measured is None else array.measured

    def echoes_of(x: np.ndarray) -> np.ndarray:
        samples = simulate(Scatterers(points_m, x.ravel()), tones_hz, array, False, tolerance)
        return (samples * measured).ravel()

    def adjoint(y: np.ndarray) -> np.ndarray:
        samples = y.reshape(shape) * measured
        return image(samples, tones_hz, array, tolerance=tolerance).ravel()

    size = int(np.prod(shape)), len(points_m)
    return LinearOperator(size, echoes_of, adjoint, dtype=np.complex64)
