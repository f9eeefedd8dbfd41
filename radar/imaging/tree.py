"""The tree of boxes of fast imaging: each box keeps only the few of its parent's tones and antennas
that the image of its points needs.

Within a small box, the waves of most tones and antennas are linear combinations of those of a few.
Let R_a(p) be the distance from antenna a to point p, ΔR_a(p) = R_a(p) − R_a(c) its difference from
that to the box's centre c, and S the parent's samples without the phase of the paths to the
parent's centre. The box's samples are then

    M[m, a, b] = Σ_f Σ_t Σ_r  L[m, f] X[a, t] Y[b, r] e^{jk_f(R_t(c) + R_r(c))} S[f, t, r],

and O(p) = Σ_m Σ_ab e^{jk_mΔR_a(p)} M[m, a, b] e^{jk_mΔR_b(p)} for every p of the box (a butterfly:
Michielssen & Boag 1996; Candès, Demanet & Ying 2009). L, X and Y are the real weights of
interpolative decompositions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.distance import cdist

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, Aperture, Leg
from handbench.radar.imaging.skeleton import band_kernel, skeleton
from handbench.radar.imaging.steering import probe_gains, steered_differences

# Kept members, at least → factor of the tolerance below which a skeleton's worst residual is. The
# errors of many members average out. With five or fewer they are similar and near the bound: those
# of both legs in cell and leaf, and of the tones, add up to √6 of it (1.2 of the tolerance was
# measured 100 m away). The factors hold the tolerance for a single live channel too, whose error
# nothing averages (measured at worst on the paper's volume: 0.9 of the tolerance, 0.7 for white
# noise; with 1.6 in place of 1.3: 1.16).
TOLERANCE_FACTORS = {16: 1.3, 6: 1.0, 0: 0.4}
# In a box of fewer wavelengths than this the residuals of all points are similar, and add up where
# the points' echoes cancel: to twice the tolerance for 60 points within 2.5 mm, each of which met
# it. The factor of the tolerance is then SMALL_BOX_FACTOR.
SMALL_BOX_WAVELENGTHS = 2.0
SMALL_BOX_FACTOR = 0.1
PROBES = 4  # points at which a family of antennas is sampled, per antenna
DIRECT = 512  # antennas that are decomposed at once
SPARSE = 1e9  # half-wavelengths cubed in a box: 2 m by 2 m by 2 m at 77 GHz
CROWDED = 1024  # antennas of a leg above which skeletons cost more than they save

# tolerance → members and weights of a skeleton
Reduce = Callable[[float], tuple[np.ndarray, np.ndarray]]


class Box(NamedTuple):
    """An axis-aligned box, metres."""

    low_m: np.ndarray
    high_m: np.ndarray

    @property
    def centre_m(self) -> np.ndarray:
        """The centre [3]."""
        return (self.low_m + self.high_m) / 2

    @property
    def corners_m(self) -> np.ndarray:
        """The corners [8, 3]."""
        return np.array(list(product(*zip(self.low_m, self.high_m, strict=True))))

    def part(self, counts: np.ndarray, number: int) -> "Box":
        """Return one of the equal boxes into which the box is divided, counts [3] of them along x,
        y, z. number: which one; z varies fastest."""
        place = np.unravel_index(number, counts)
        edges_m = [
            np.linspace(low_m, high_m, n + 1)[i : i + 2]
            for low_m, high_m, n, i in zip(*self, counts, place, strict=True)
        ]
        return Box(*np.array(edges_m).T)


class Step(NamedTuple):
    """What makes the samples of a box from those of its parent (`radar.imaging.boxes`).

    shift_a [t], shift_b [r]: path lengths Δ to transmitters and receivers, metres, which change the
    reference of phases to the box's centre; of_tones [m, f], of_a [a, t], of_b [b, r]: the real
    weights L, X and Y, of which empty ones leave their axis unchanged.
    """

    shift_a: np.ndarray
    shift_b: np.ndarray
    of_tones: np.ndarray
    of_a: np.ndarray
    of_b: np.ndarray


@dataclass(frozen=True)
class Node:
    """A box of the tree with the tones and antennas that it keeps, and the weights that combine the
    samples of its parent box into its own.

    turns_per_m [k]: f/c of the kept tones; legs: the kept transmitters and the kept receivers;
    numbers, for both [n]: index of each among all of the aperture; lengths_m, for both [n]: the
    path on this leg from each to the box's centre, whose phase is removed from the box's samples (0
    in the root of the tree).

    tone_weights [k, parent's k] and, for transmitters and receivers, leg_weights [n, parent's n]
    are real; empty weights mean that all tones or antennas are kept. shifts_m, for transmitters and
    receivers [parent's n]: path lengths whose phase is applied to the parent's samples first, to
    move their phase reference from the parent's centre to this box's.
    """

    box: Box
    turns_per_m: np.ndarray
    legs: tuple[Leg, ...]
    numbers: tuple[np.ndarray, ...]
    lengths_m: tuple[np.ndarray, ...]
    tone_weights: np.ndarray
    leg_weights: tuple[np.ndarray, ...]
    shifts_m: tuple[np.ndarray, ...]

    @cached_property
    def step(self) -> Step:
        """The step from the parent's samples to those of this box."""
        (shift_a, shift_b), (of_a, of_b) = self.shifts_m, self.leg_weights
        return Step(shift_a, shift_b, self.tone_weights, of_a, of_b)


class NodeStack(NamedTuple):
    """The n nodes of some boxes as arrays, each padded with zeros to common sizes.

    counts [n, 3]: numbers of tones, transmitters and receivers; centre_m [n, 3]; turns_per_m [n,
    k]; tone_weights [n, k, parent's k]. legs: for transmitters and for receivers the float32
    weights [n, a, parent's a], and float64 shifts [n, parent's a], lengths [n, a] and positions [n,
    a, 3], metres. Weights are empty where all nodes keep all, and identities where only some do.
    """

    counts: np.ndarray
    centre_m: np.ndarray
    turns_per_m: np.ndarray
    tone_weights: np.ndarray
    legs: tuple[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], ...]

    def part(self, index: np.ndarray) -> "NodeStack":
        """Return the nodes with these indices."""
        counts, centre_m, turns_per_m, tone_weights = (values[index] for values in self[:-1])
        legs = tuple(tuple(values[index] for values in leg) for leg in self.legs)
        return NodeStack(counts, centre_m, turns_per_m, tone_weights, legs)

    @property
    def step(self) -> Step:
        """The step from the parent's samples to those of these boxes."""
        (of_a, shift_a, _, _), (of_b, shift_b, _, _) = self.legs
        return Step(shift_a, shift_b, self.tone_weights, of_a, of_b)

    @property
    def places(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Lengths and positions of the antennas of both legs."""
        return tuple((length_m, position_m) for _, _, length_m, position_m in self.legs)


def stack(nodes: list[Node]) -> NodeStack:
    """Stack nodes as arrays, for compiled code and for devices."""
    tones = [len(node.turns_per_m) for node in nodes]
    antennas = [[len(node.numbers[leg]) for node in nodes] for leg in (0, 1)]
    legs = tuple(
        (
            _stacked_weights([node.leg_weights[leg] for node in nodes], antennas[leg]),
            _padded([node.shifts_m[leg] for node in nodes]),
            _padded([node.lengths_m[leg] for node in nodes]),
            _padded([node.legs[leg].position_m for node in nodes]),
        )
        for leg in (0, 1)
    )
    return NodeStack(
        np.array([tones, *antennas]).T.copy(),
        np.array([node.box.centre_m for node in nodes]),
        _padded([node.turns_per_m for node in nodes]),
        _stacked_weights([node.tone_weights for node in nodes], tones),
        legs,
    )


def _stacked_weights(weights: list[np.ndarray], counts: list[int]) -> np.ndarray:
    if not any(array.size for array in weights):
        return np.zeros((len(weights), 0, 0), np.float32)
    full = [array if array.size else np.eye(n) for array, n in zip(weights, counts, strict=True)]
    return _padded(full).astype(np.float32)


def _padded(arrays: list[np.ndarray]) -> np.ndarray:
    stacked = np.zeros((len(arrays), *np.max([array.shape for array in arrays], axis=0)))
    for row, array in zip(stacked, arrays, strict=True):
        row[tuple(map(slice, array.shape))] = array
    return stacked


class Family(NamedTuple):
    """Settings that all boxes of a tree share.

    tolerance: relative L2 error; per_tone: keep all tones, for one image per tone; whole: keep all
    antennas. The others are for simulation: detour_m: largest extra path of diffracted echoes,
    metres; pattern: None if echoes have no gains, else the exponent q of the antennas' pattern
    cosᵠθ, with which waves have the gains 1/R and cosᵠθ; beside: sine of the largest angle between
    a diffracted wave and the straight ray.
    """

    tolerance: float
    per_tone: bool
    detour_m: float = 0.0
    whole: bool = False
    pattern: float | None = None
    beside: float = 0.0


def needs_direct_sum(aperture: Aperture) -> bool:
    """Return True for an aperture whose images are always summed exactly, because choosing few of
    its antennas costs more than it saves.

    These are apertures with more than CROWDED antennas on one side (a raster scan has tens of
    thousands of positions), and lists of antenna pairs.
    """
    pairs = isinstance(aperture, AntennaPairs) and not aperture.monostatic
    return pairs or max(aperture.channels) > CROWDED


def root_node(frequencies_hz: np.ndarray, aperture: Aperture) -> Node:
    """Return the root of the tree of boxes: it keeps all tones and antennas, and no phase is
    removed from its samples."""
    numbers = tuple(np.arange(len(leg.position_m)) for leg in aperture.legs)
    lengths_m = tuple(np.zeros(len(number)) for number in numbers)
    nothing = np.zeros((0, 0), np.float32)
    everywhere = Box(np.full(3, -np.inf), np.full(3, np.inf))
    turns_per_m = np.asarray(frequencies_hz, np.float64) / SPEED_OF_LIGHT_M_S
    return Node(
        everywhere,
        turns_per_m,
        aperture.legs,
        numbers,
        lengths_m,
        nothing,
        (nothing, nothing),
        (np.zeros(0), np.zeros(0)),
    )


def child_node(parent: Node, box: Box, family: Family, keep_antennas: bool = False) -> Node:
    """Choose the tones and antennas that a box needs, and compute the weights that combine the
    samples of its parent, a larger box around it, into the samples of this box.

    keep_antennas: choose among the tones only, and keep all antennas.
    """
    lengths = [
        leg.passes * _distances(leg.position_m, box.centre_m[None])[:, 0] for leg in parent.legs
    ]
    shifts = tuple(map(np.subtract, lengths, parent.lengths_m))
    tones, tone_weights = _tones(parent, box, lengths, family)
    turns_per_m = parent.turns_per_m[tones]
    chosen = (_antennas(leg, box, turns_per_m, family, keep_antennas) for leg in parent.legs)
    index, weights = zip(*chosen, strict=True)
    legs = tuple(map(Leg.only, parent.legs, index))
    numbers = tuple(map(np.take, parent.numbers, index))
    lengths_m = tuple(map(np.take, lengths, index))
    return Node(box, turns_per_m, legs, numbers, lengths_m, tone_weights, weights, shifts)


def clusters(points_m: np.ndarray, frequencies_hz: np.ndarray) -> list[np.ndarray]:
    """Group points [n, 3] into clusters that are each compact enough for one plan: a list of index
    arrays.

    The points' bounding box is halved until each box has a volume of at most SPARSE cubes of half a
    wavelength.
    """
    half_wavelength_m = SPEED_OF_LIGHT_M_S / np.max(frequencies_hz) / 2
    parts, near = [np.arange(len(points_m))], []
    while parts:
        part = parts.pop()
        extent = np.ptp(points_m[part], axis=0)
        if np.prod(1 + extent / half_wavelength_m) <= SPARSE or len(part) == 1:
            near.append(part)
            continue
        axis = int(extent.argmax())
        beyond = points_m[part, axis] > points_m[part, axis].min() + extent[axis] / 2
        parts += [part[beyond], part[~beyond]]
    return near


def _tones(
    parent: Node, box: Box, lengths: list[np.ndarray], family: Family
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the tones of which all others are linear combinations within the box: (indices of the
    chosen, real weights [chosen, all]; with empty weights all are kept).

    lengths: for transmitters and receivers, the paths [n] from the parent's antennas to the box's
    centre, metres. Paths to other points of the box differ from those by at most d = Σ_legs
    max|ΔR|, so that the phases, as functions of the wavenumber, are band-limited to ±d.
    """
    every = np.arange(len(parent.turns_per_m))
    if family.per_tone or len(every) <= 2:
        return every, np.zeros((0, 0), np.float32)
    # distances are convex, so that they are largest in a corner; the lowest may be the centre's
    reach_m = sum(
        np.abs(leg.passes * _distances(leg.position_m, box.corners_m) - length[:, None]).max()
        for leg, length in zip(parent.legs, lengths, strict=True)
    )
    reach_m += family.detour_m
    wavenumber = 2 * np.pi * parent.turns_per_m[:, None]
    reduce = partial(skeleton, band_kernel(wavenumber, wavenumber, np.array([reach_m])))
    return _reduced(reduce, box, parent.turns_per_m, family.tolerance)


def _antennas(
    leg: Leg, box: Box, turns_per_m: np.ndarray, family: Family, keep: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the transmitters, or the receivers, whose waves give those of all others within the
    box by linear combination: (indices of the chosen, real weights [chosen, all]; with empty
    weights all are kept).

    The wave of antenna a is e^{jk(R_a(p) − R_a(c))} for points p in the box, its centre c and all
    tones. The waves are sampled, not bounded by a band: near the aperture they are chirps, whose
    spectrum leaks out of any band. Real weights that fit the waves also fit their conjugates, so
    the real part of the Gram matrix is enough. In simulations, gains are part of the waves: in a
    small box few antennas determine all phases, but not how 1/R and the pattern vary from one
    antenna to the next. A box around an antenna keeps all antennas, because the distance has a kink
    there.

    keep: choose nothing and keep all antennas.
    """
    n = len(leg.position_m)
    if keep or family.whole or n == 1:
        return np.arange(n), np.zeros((0, 0), np.float32)
    if family.beside > 0:
        margin_m = family.beside * float(_distances(leg.position_m, box.corners_m).max())
        box = Box(box.low_m - margin_m, box.high_m + margin_m)
    if (np.abs(leg.position_m - box.centre_m) <= box.high_m - box.low_m).all(axis=1).any():
        return np.arange(n), np.eye(n, dtype=np.float32)
    return _reduced(
        _family_skeletons(leg, box, turns_per_m, family.pattern), box, turns_per_m, family.tolerance
    )


def _reduced(
    reduce: Reduce, box: Box, turns_per_m: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Choose tones or antennas with the function `reduce`, tolerance → (indices, weights):
    (indices, float32 weights).

    `reduce` gets the tolerance times a factor: a smaller one if few tones or antennas remain, since
    their errors average out less, and if the box is small in wavelengths.
    """
    small = (box.high_m - box.low_m).max() * turns_per_m.max() < SMALL_BOX_WAVELENGTHS
    for least, factor in ({0: SMALL_BOX_FACTOR} if small else TOLERANCE_FACTORS).items():
        index, weights = reduce(factor * tolerance)
        if len(index) >= least:
            break
    return index, np.ascontiguousarray(weights, np.float32)


def _family_skeletons(leg: Leg, box: Box, turns_per_m: np.ndarray, pattern: float | None) -> Reduce:
    """Return the function tolerance → (indices, weights [chosen, n]) that chooses those of n
    transmitters, or receivers, whose waves represent the waves of all in a box.

    pattern: exponent of the antennas' pattern, None for waves without gains. More than DIRECT
    antennas are divided into halves, recursively, which are reduced separately.
    """
    n = len(leg.position_m)
    if n > DIRECT:
        order = np.argsort(
            leg.position_m[:, np.argmax(np.ptp(leg.position_m, axis=0))], kind="stable"
        )
        halves = np.array_split(order, 2)
        of_half = [_family_skeletons(leg.only(half), box, turns_per_m, pattern) for half in halves]

        def joined(tolerance: float) -> tuple[np.ndarray, np.ndarray]:
            (first, above), (second, below) = (reduce(tolerance) for reduce in of_half)
            weights = np.empty((len(first) + len(second), n))
            weights[:, order] = block_diag(above, below)
            return np.concatenate([halves[0][first], halves[1][second]]), weights

        return joined
    points_m, turns = _probes(box, turns_per_m, PROBES * n)
    lengths_m = cdist(points_m, leg.position_m)
    at_centre_m = _distances(leg.position_m, box.centre_m[None])[:, 0]
    waves = steered_differences(lengths_m, at_centre_m, leg.passes * turns)
    if pattern is not None:
        gains = probe_gains(points_m, leg.position_m, lengths_m, pattern)
        waves *= np.concatenate([gains, gains])
    return partial(skeleton, waves.T @ waves / len(points_m))


def _probes(box: Box, turns_per_m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Choose points [count, 3] in the box at which waves are sampled, and a tone f/c [count] (1/m)
    for each. The points are denser towards the box's faces, where errors are largest."""
    across, share = _sequence(count)
    low, high = turns_per_m.min(), turns_per_m.max()
    return box.low_m + (box.high_m - box.low_m) * across, low + (high - low) * share


@lru_cache(maxsize=256)
def _sequence(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points [count, 3] of the unit cube and shares [count] of a band, 0 to 1, spread by an
    additive sequence (Roberts' generalised golden ratio); deterministic. Cached: callers must not
    change the arrays."""
    golden = 1.1673039782614187  # g⁵ = g + 1: the ratio for four dimensions
    u = (0.5 + np.arange(count)[:, None] / golden ** np.arange(1, 5)) % 1.0
    across = (1 - np.cos(np.pi * u[:, :3])) / 2
    across[:8] = np.indices((2, 2, 2)).reshape(3, 8).T[: len(across)]  # the corners first
    return across, np.where(np.arange(count) % 2, u[:, 3], 1.0)


def _distances(antennas_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return the distances [a, p] between antennas [a, 3] and points [p, 3]."""
    return np.sqrt(((antennas_m[:, None] - points_m[None]) ** 2).sum(axis=2))
