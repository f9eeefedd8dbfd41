"""Skeletons: a few members of a band-limited family carry all the others.

Antennas and tones that few of them carry (interpolative decomposition), and the samples of an axis that a few coarse
nodes carry (band-limited upsampling): with positions in the axis' own unit and a spectrum within ±w,
fine = W · nodes, W = K_fn (K_nn + λI)⁻¹ and K(Δ) = J₀(wΔ): least squares over functions whose spectrum crowds at ±w,
where an even one (sinc) errs three times more.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtrtrs
from scipy.special import j0

from radar.support.compiled import njit

TIE = 1e-6  # relative difference below which two members are as good
GUARD = 2  # nodes beyond either end
REGULARISATION = 0.03  # λ over the squared tolerance: weights stay near one except at the ends
WINDOW = 48  # intervals whose fine samples share their nodes: cost grows with the axis, not with its square ...
INNER_GUARD = 6  # ... and nodes beyond them on either side, where they exist anyway

AMPLIFICATION = 1.6  # of the nodes' own errors, root mean square over the fine samples
PROBED = 33  # frequencies at which the misfit is looked up


def skeleton(gram: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Pivoted Cholesky of a positive semi-definite kernel [n, n] with unit diagonal until no member is further than
    `tolerance` from the span of those chosen.

    Returns indices s [k] and real weights X [k, n] with member_i ≈ Σ_m X[m, i] · member_s[m].
    """
    index, factor = _pivoted_cholesky(np.ascontiguousarray(gram, np.float64), tolerance**2)
    # G_ss⁻¹ G_s,all with G = factorᵀ factor; the checks of solve_triangular would take a quarter of a plan's time
    weights, _ = dtrtrs(factor[:, index].T, factor, lower=1, trans=1)
    return index, weights


def band_skeleton(position: np.ndarray, half_band: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Skeleton of functions sampled at position [n, d] whose spectrum lies within ±half_band [d] (rad per unit).

    The kernel Π J₀(w Δ) stands for a spectrum that crowds at the band's edges; sinc, which stands for an even one,
    leaves errors there that are three to four times larger for the same number of members.
    """
    return skeleton(band_kernel(position, position, half_band), tolerance)


def band_kernel(a: np.ndarray, b: np.ndarray, half_band: np.ndarray) -> np.ndarray:
    """Π J₀(w (a − b)): [n, m] for positions a [n, d], b [m, d] and half_band [d]."""
    gram = np.ones((len(a), len(b)))
    for x, y, w in zip(a.T, b.T, half_band, strict=True):
        if w > 0 and (np.ptp(x) > 0 or np.ptp(y) > 0):
            gram *= j0(w * (x[:, None] - y))
    return gram


@njit(nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"})
def _pivoted_cholesky(gram, least):  # type: ignore[no-untyped-def]
    n = len(gram)
    residual, factor, index = np.empty(n), np.empty((n, n)), np.empty(n, np.int64)
    for j in range(n):
        residual[j] = gram[j, j]
    for k in range(n):
        pivot = 0
        for j in range(1, n):  # symmetric arrays have ties, which rounding must not decide: the first one counts
            if residual[j] > (1 + TIE) * residual[pivot]:
                pivot = j
        if residual[pivot] <= least:
            return index[:k], factor[:k]
        row = factor[k]
        for j in range(n):
            row[j] = gram[pivot, j]
        for i in range(k):
            weight = factor[i, pivot]
            for j in range(n):
                row[j] -= weight * factor[i, j]
        scale = 1 / np.sqrt(residual[pivot])
        for j in range(n):
            row[j] *= scale
            residual[j] -= row[j] * row[j]
        residual[pivot] = 0.0
        index[k] = pivot
    return index, factor


@dataclass(frozen=True)
class Resampler:
    """nodes_m [n] and, per window, (fine slice, node slice, weights [fine, nodes] float32); no windows: the nodes are
    the fine samples."""

    nodes_m: np.ndarray
    windows: tuple[tuple[slice, slice, np.ndarray], ...]

    def apply(self, nodes: np.ndarray, out: np.ndarray) -> None:
        """Node values [..., n] → fine values out [..., fine], float32."""
        if not self.windows:
            out[...] = nodes
        for fine, of, weights in self.windows:
            out[..., fine] = nodes[..., of] @ weights.T

    def along_first(self, nodes: np.ndarray) -> np.ndarray:
        """Node values [n, m] → fine values [fine, m], float32."""
        if not self.windows:
            return nodes
        fine = np.empty((self.windows[-1][0].stop, nodes.shape[1]), np.float32)
        for out, of, weights in self.windows:
            np.dot(weights, nodes[of], out=fine[out])
        return fine

    def of(self, fine: int, least: float = 0.0) -> tuple[slice, np.ndarray]:
        """The nodes that one fine sample follows from, and their weights; those below `least` at the ends are left."""
        for here, of, weights in self.windows:
            if fine < here.stop:
                row = weights[fine - here.start]
                kept = np.flatnonzero(np.abs(row) >= least)
                return slice(of.start + kept[0], of.start + kept[-1] + 1), row[kept[0] : kept[-1] + 1]
        return slice(fine, fine + 1), np.ones(1, np.float32)

    def rows(self, most: int) -> list[tuple[slice, slice, np.ndarray | None]]:
        """The windows in pieces of at most `most` fine samples: (fine slice, node slice, weights or None)."""

        def cut(start: int, stop: int) -> list[slice]:
            return [slice(at, min(at + most, stop)) for at in range(start, stop, most)]

        if not self.windows:
            return [(here, here, None) for here in cut(0, len(self.nodes_m))]
        return [
            (here, of, weights[here.start - fine.start : here.stop - fine.start])
            for fine, of, weights in self.windows
            for here in cut(fine.start, fine.stop)
        ]


def resampler(fine_m: np.ndarray, half_band: float, tolerance: float) -> Resampler:
    """The fewest nodes for fine_m [n] (ascending, even or not) from which every frequency within ±half_band (rad/m) is
    regained with a relative L2 error of at most `tolerance`; the fine samples themselves where that saves nothing."""
    extent = fine_m[-1] - fine_m[0]
    intervals = max(int(extent * half_band / np.pi), 1)
    while intervals + 1 + 2 * GUARD < len(fine_m):
        nodes = fine_m[0] + extent / intervals * np.arange(-GUARD, intervals + 1 + GUARD)
        windows = _windows(fine_m, nodes, intervals)
        ends = [(out, of, _weights(fine_m[out], nodes[of], half_band, tolerance)) for out, of in windows[:2]]
        misfit = max(_misfit(fine_m[out], nodes[of], weights, half_band) for out, of, weights in ends)
        amplification = max(np.sqrt((weights**2).sum(axis=1).mean()) for _, _, weights in ends)
        if misfit <= tolerance and amplification <= AMPLIFICATION:
            rest = [(out, of, _weights(fine_m[out], nodes[of], half_band, tolerance)) for out, of in windows[2:]]
            return Resampler(nodes, tuple(ends + rest))
        intervals += max(intervals // 30, 1)
    return Resampler(fine_m, ())


def _windows(fine_m: np.ndarray, nodes_m: np.ndarray, intervals: int) -> list[tuple[slice, slice]]:
    """(fine slice, node slice) of every window that holds fine samples; uneven ones may leave some empty."""
    bounds = np.linspace(0, intervals, int(np.ceil(intervals / WINDOW)) + 1).round().astype(int)
    edges = np.searchsorted(fine_m, nodes_m[GUARD + bounds])
    edges[0], edges[-1] = 0, len(fine_m)
    return [
        (slice(int(start), int(stop)), slice(max(first + GUARD - INNER_GUARD, 0), last + GUARD + INNER_GUARD + 1))
        for first, last, start, stop in zip(bounds[:-1], bounds[1:], edges[:-1], edges[1:], strict=True)
        if stop > start
    ]


def _misfit(fine_m: np.ndarray, nodes_m: np.ndarray, weights: np.ndarray, half_band: float) -> float:
    """Relative L2 error over fine_m of the frequency within ±half_band that is regained worst."""
    frequency = half_band * np.cos(np.linspace(0, np.pi / 2, PROBED))  # crowded at the band's edge, where it is worst
    origin = fine_m[0]
    regained = weights @ np.exp(1j * (nodes_m - origin)[:, None] * frequency)
    wave = np.exp(1j * (fine_m - origin)[:, None] * frequency)
    return float(np.sqrt((np.abs(regained - wave) ** 2).mean(axis=0).max()))


def _weights(fine_m: np.ndarray, nodes_m: np.ndarray, half_band: float, tolerance: float) -> np.ndarray:
    w = np.array([half_band])
    among = band_kernel(nodes_m[:, None], nodes_m[:, None], w) + REGULARISATION * tolerance**2 * np.eye(len(nodes_m))
    across = band_kernel(nodes_m[:, None], fine_m[:, None], w)
    return np.ascontiguousarray(np.linalg.solve(among, across).T, np.float32)
