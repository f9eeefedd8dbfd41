"""Fast simulation of point scatterers by the tree of boxes: scatterers → samples.

This is the exact adjoint of imaging by the same tree (`radar.imaging.cpu.forward`): conjugate
phases, transposed weights, and the steps in reverse order.
"""

from typing import NamedTuple

import numpy as np

from handbench.radar.imaging.cpu.forward import (
    BLOCK,
    SECOND_LEVEL,
    apply,
    differences,
    inner_turn,
    mix,
    steer,
)
from handbench.radar.imaging.cpu.steering import cis_turns
from handbench.support.compiled import FAST, INNER, njit, outer


class Sight(NamedTuple):
    """The complex factor by which obstacles change the wave between each antenna and each point: 1
    in full sight, 0 in full shadow, and in between, near shadow edges, the result of diffraction.

    The factor is smooth over points, antennas and frequency, so it is tabulated at few of each.
    corner [3, n]: the three surface samples around each point (−1: the point is in full sight of
    all antennas), whose table entries are interpolated with barycentric weights `share` [3, n].
    table_a [surface samples, 3, nodes], complex64: coefficients of 1, u and u², u = (f/c − middle)
    / half, at some transmitters (nodes); spread_a [a, nodes] interpolates them to all transmitters.
    table_b, spread_b: the same arrays for the receivers. detour_m: longest extra path of diffracted
    waves; beside: sine of the largest angle between them and the straight ray.
    """

    corner: np.ndarray
    share: np.ndarray
    table_a: np.ndarray
    spread_a: np.ndarray
    table_b: np.ndarray
    spread_b: np.ndarray
    middle: float
    half: float
    detour_m: float
    beside: float

    @property
    def partial(self) -> np.ndarray:
        """Boolean mask [n]: True for points that are not in full sight of all antennas."""
        return self.corner[0] >= 0

    def where(self, chosen: np.ndarray) -> "Sight":
        """Return the factors of some of the points only, chosen by mask or index."""
        return self._replace(
            corner=self.corner[:, chosen].copy(), share=self.share[:, chosen].copy()
        )

    def weights(self, leg: int, turns_per_m: float) -> np.ndarray:
        """Compute the complex factor of the wave between each antenna (leg 0: transmitters, 1:
        receivers) and each point, at turns_per_m = f/c: [a, n], 1 for points in full sight."""
        table, spread = (self.table_a, self.spread_a) if leg == 0 else (self.table_b, self.spread_b)
        u = (turns_per_m - self.middle) / self.half
        nodes = table.transpose(0, 2, 1) @ np.array([1, u, u * u])
        return np.where(
            self.partial, spread @ (nodes[self.corner] * self.share[:, :, None]).sum(axis=0).T, 1
        )


NO_TABLE, NO_SPREAD = np.zeros((0, 3, 0), np.complex64), np.zeros((0, 0), np.float32)
NOTHING = np.zeros((3, 0))
FULL_SIGHT = Sight(
    NOTHING.astype(np.int32),
    NOTHING.astype(np.float32),
    NO_TABLE,
    NO_SPREAD,
    NO_TABLE,
    NO_SPREAD,
    0.0,
    1.0,
    0.0,
    0.0,
)


class PackedScatterers(NamedTuple):
    """Point scatterers as arrays for compiled code, sorted by the leaves (smallest boxes) of a
    plan.

    point_m [3, n]; weight [n] complex64; normal [3, n] of facets, or [3, 0]; spreading: whether
    echoes have gains (1/R, obliquity, pattern); pattern: exponent q of the antennas' cosᵠθ. seen_a
    [a, n], seen_b [b, n]: 1 where a transmitter or a receiver sees a point and 0 where not, or
    [0, 0] if all do; such masks need a plan in which no antennas were replaced by fewer equivalent
    ones. sight: by how much obstacles weaken and turn the waves between each antenna and each
    point, as polynomials over frequency.
    """

    point_m: np.ndarray
    weight: np.ndarray
    normal: np.ndarray
    spreading: bool
    pattern: float
    seen_a: np.ndarray
    seen_b: np.ndarray
    sight: Sight


@njit(**FAST)
def scatter(  # type: ignore[no-untyped-def]
    source, turns_per_m, step, place, passes, reference_m, start, stop
):
    """Compute what the scatterers in one leaf contribute to the echo samples of the cell around it:
    float32 [k, 2, a, b], 2 for real and imaginary part. It is the adjoint of `forward.image_leaf`.

    source: `PackedScatterers`, of which start:stop are in the leaf; turns_per_m: f/c of the cell's
    k tones; step, place: those of the leaf's `Node`; passes [2]: how often the path goes between
    target and transmitter, and between target and receiver; reference_m [2, 3]: points near the
    antennas, to which path differences are computed.
    """
    leaf = radiate(_part(source, start, stop), place, passes, reference_m)
    return inner_to_parent(leaf, turns_per_m, *step)


@njit(**INNER)
def inner_to_parent(  # type: ignore[no-untyped-def]
    samples, turns_per_m, shift_a, shift_b, tone_weights, weights_a, weights_b
):
    """Compute what the samples [k', 2, a', b'] of a box contribute to the samples [k, 2, a, b] of
    its parent box: the adjoint of `forward.to_child`, with the same arguments."""
    spread = apply(weights_a.T.copy(), weights_b.T.copy(), samples)
    return inner_turn(
        mix(tone_weights.T.copy(), spread), turns_per_m, shift_a, shift_b, np.float32(-1.0)
    )


to_parent = outer(inner_to_parent)


@njit(**INNER)
def radiate(source, place, passes, reference_m):  # type: ignore[no-untyped-def]
    """Compute the echo samples of a leaf (a smallest box) from the scatterers in it: float32 [k, 2,
    a, b], 2 for real and imaginary part. It is the adjoint of `forward.evaluate`.

    source: these scatterers (`PackedScatterers`); place: the leaf's centre, tones and antennas,
    from its `Node`.
    """
    centre_m, turns_per_m, (length_a, position_a, number_a), (length_b, position_b, number_b) = (
        place
    )
    tones, n_a, n_b = len(turns_per_m), len(length_a), len(length_b)
    samples = np.zeros((tones, 2, n_a, n_b), np.float32)
    sight, weighted = source.sight, source.sight.corner.shape[1] > 0
    if weighted:
        spread_a, spread_b = (sight.spread_a[number_a], sight.spread_b[number_b])
    block = max(min(BLOCK, SECOND_LEVEL // (n_a + n_b)), 16)
    for start in range(0, source.point_m.shape[1], block):
        stop = min(start + block, source.point_m.shape[1])
        n = stop - start
        points = source.point_m[:, start:stop].copy()
        common = np.zeros(n)
        delta_a, delta_b = np.empty((n_a, n), np.float32), np.empty((n_b, n), np.float32)
        differences(
            points, position_a, passes[0], length_a, centre_m, reference_m[0], delta_a, common
        )
        differences(
            points, position_b, passes[1], length_b, centre_m, reference_m[1], delta_b, common
        )
        gain_a = _gains(source, start, points, position_a, source.seen_a)
        gain_b = _gains(source, start, points, position_b, source.seen_b)
        a, b = np.empty((2 * n_a, n), np.float32), np.empty((2 * n_b, n), np.float32)
        if weighted:
            factors_a = _leg_factors(sight.corner, sight.share, start, n, sight.table_a, spread_a)
            factors_b = _leg_factors(sight.corner, sight.share, start, n, sight.table_b, spread_b)
        for m in range(tones):
            steer(delta_a, -turns_per_m[m], a)
            steer(delta_b, -turns_per_m[m], b)
            if weighted:
                u = np.float32((turns_per_m[m] - sight.middle) / sight.half)
                _weigh(a, factors_a, u)
                _weigh(b, factors_b, u)
            weight = np.empty((2, n), np.float32)
            for p in range(n):
                cosine, sine = cis_turns(-turns_per_m[m] * common[p])
                w = source.weight[start + p]
                weight[0, p] = w.real * cosine - w.imag * sine
                weight[1, p] = w.real * sine + w.imag * cosine
            for i in range(n_a):
                for p in range(n):
                    re, im = gain_a[i, p] * a[i, p], gain_a[i, p] * a[n_a + i, p]
                    a[i, p] = re * weight[0, p] - im * weight[1, p]
                    a[n_a + i, p] = re * weight[1, p] + im * weight[0, p]
            for i in range(n_b):
                for p in range(n):
                    b[i, p] *= gain_b[i, p]
                    b[n_b + i, p] *= gain_b[i, p]
            product = np.dot(a, b.T)
            for i in range(n_a):
                for k in range(n_b):
                    samples[m, 0, i, k] += product[i, k] - product[n_a + i, n_b + k]
                    samples[m, 1, i, k] += product[i, n_b + k] + product[n_a + i, k]
    return samples


@njit(**INNER)
def _gains(source, start, points_m, position_m, seen):  # type: ignore[no-untyped-def]
    """Compute the gain between each antenna and each of p points_m [3, p], which are the source's
    from index `start` on: float32 [a, p].

    The gain is 1/R, times √(n·û) for scatterers with normals, times the antennas' pattern cosᵠθ. If
    source.spreading is False, it is 1. It is 0 where an antenna does not see a point (mask `seen`).
    """
    n = points_m.shape[1]
    gain = np.ones((len(position_m), n), np.float32)
    if source.spreading:
        for a in range(len(position_m)):
            for p in range(n):
                dx = position_m[a, 0] - points_m[0, p]
                dy = position_m[a, 1] - points_m[1, p]
                dz = position_m[a, 2] - points_m[2, p]
                distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                obliquity = 1.0
                if source.normal.shape[1] > 0:
                    i = start + p
                    along = (
                        source.normal[0, i] * dx
                        + source.normal[1, i] * dy
                        + source.normal[2, i] * dz
                    )
                    obliquity = max(along / distance, 0.0)
                gain[a, p] = np.sqrt(obliquity) / distance
                if source.pattern != 0.0:
                    gain[a, p] *= max(-dz / distance, 0.0) ** source.pattern
    if seen.size != 0:
        gain *= seen[:, start : start + n]
    return gain


@njit(**INNER)
def _leg_factors(corner, share, start, n, table, spread):  # type: ignore[no-untyped-def]
    """Interpolate the tabulated factors of partly blocked waves (see `Sight`) to n points, from
    index `start` on, and to all transmitters or all receivers, a in number: float32 [3, 2a, n].

    The first axis has the coefficients of 1, u and u² of the scaled frequency u; the second has the
    real parts above the imaginary parts.
    """
    nodes, n_a = table.shape[2], len(spread)
    at_nodes, factors = np.empty((2, nodes, n), np.float32), np.empty((3, 2, n_a, n), np.float32)
    for power in range(3):
        for p in range(n):
            one, two, three = corner[0, start + p], corner[1, start + p], corner[2, start + p]
            s1, s2, s3 = share[0, start + p], share[1, start + p], share[2, start + p]
            for i in range(nodes):
                mixed = (
                    s1 * table[one, power, i]
                    + s2 * table[two, power, i]
                    + s3 * table[three, power, i]
                )
                at_nodes[0, i, p], at_nodes[1, i, p] = mixed.real, mixed.imag
        for part in range(2):
            np.dot(spread, at_nodes[part], factors[power, part])
    return factors.reshape(3, 2 * n_a, n)


@njit(**INNER)
def _weigh(steered, factors, u):  # type: ignore[no-untyped-def]
    """Multiply the waves `steered` [2a, n] (real parts above imaginary parts), in place, by the
    factors of partly blocked waves: polynomials in the scaled frequency u with coefficients factors
    [3, 2a, n]."""
    n_a = len(steered) // 2
    for i in range(n_a):
        for p in range(steered.shape[1]):
            re = factors[0, i, p] + u * (factors[1, i, p] + u * factors[2, i, p])
            im = factors[0, n_a + i, p] + u * (factors[1, n_a + i, p] + u * factors[2, n_a + i, p])
            x, y = steered[i, p], steered[n_a + i, p]
            steered[i, p], steered[n_a + i, p] = re * x - im * y, re * y + im * x


@njit(**INNER)
def _part(source, start, stop):  # type: ignore[no-untyped-def]
    """Return the packed scatterers start:stop; optional arrays that are empty stay empty."""
    here = slice(start, stop)
    normal = source.normal if source.normal.shape[1] == 0 else source.normal[:, here]
    seen_a = source.seen_a if source.seen_a.size == 0 else source.seen_a[:, here]
    seen_b = source.seen_b if source.seen_b.size == 0 else source.seen_b[:, here]
    places = source.point_m[:, here], source.weight[here], normal
    sight = source.sight
    legs = sight.table_a, sight.spread_a, sight.table_b, sight.spread_b
    part = Sight(sight.corner[:, here], sight.share[:, here], *legs, *sight[6:])
    return PackedScatterers(*places, source.spreading, source.pattern, seen_a, seen_b, part)
