"""Skeletons: the few members of a band-limited family of functions from which all others are
interpolated.

For the waves of antennas and tones, the skeleton comes from an interpolative decomposition. For the
fine samples of an axis, it is a coarser set of nodes, and interpolation is band-limited upsampling:
for a spectrum within ±w, fine = W · nodes with W = K_fn (K_nn + λI)⁻¹ and K(Δ) = J₀(wΔ). This is
the least-squares solution for a spectrum that is concentrated at ±w; that for a flat spectrum (K =
sinc) has three times larger errors there.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dtrtrs
from scipy.special import j0

from handbench.support.compiled import njit

TIE = 1e-6  # relative difference below which two members count as equally good
# nodes are closer together by this share at either end, and by 1/e of it REACH nodes inside
CROWDING, REACH = 0.6, 4.0
REGULARISATION = 0.03  # λ over the squared tolerance: weights stay near one except at the ends

BAND_STEP = (
    1.015  # factor by which a band is widened until the worst channel's error is at most ...
)
SINGLE = 1.6  # ... this many times the tolerance
AMPLIFICATION = 1.6  # of the nodes' own errors, at most; root mean square over the fine samples
PROBED = 49  # frequencies at which the misfit is computed


def skeleton(gram: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose those members of a family (of tones or antennas) from which all n can be interpolated:
    (indices s [k], real weights X [k, n]) with member_i ≈ Σ_m X[m, i] · member_s[m].

    gram [n, n]: kernel (inner products) of the members, positive semi-definite with unit diagonal.
    Its pivoted Cholesky decomposition chooses members until no other is further than `tolerance`
    from the span of those chosen.
    """
    n = len(gram)
    index, factor = np.empty(n, np.int64), np.empty((n, n))
    residual = gram.diagonal().copy()
    count = _pivoted_cholesky(np.ascontiguousarray(gram), tolerance**2, residual, index, factor)
    index, factor = index[:count], factor[:count]
    # G_ss⁻¹ G_s,all with G = factorᵀ factor; the checks of solve_triangular would take a quarter of
    # a plan's time
    weights, _ = dtrtrs(factor[:, index].T, factor, lower=1, trans=1)
    return index, weights


def band_kernel(a: np.ndarray, b: np.ndarray, half_band: np.ndarray) -> np.ndarray:
    """Compute the correlation Π J₀(w (a − b)) of waves at points a [n, d] and b [m, d] whose
    spectrum is concentrated at the edges ±w of a band: [n, m]. half_band [d]: w along each axis.

    For an interpolation with as many nodes, the kernel of a flat spectrum, sinc, has three to four
    times larger errors at the band's edges.
    """
    gram = np.ones((len(a), len(b)))
    for x, y, w in zip(a.T, b.T, half_band, strict=True):
        if w > 0 and (np.ptp(x) > 0 or np.ptp(y) > 0):
            gram *= j0(w * (x[:, None] - y))
    return gram


@njit(nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"})
def _pivoted_cholesky(gram, least, residual, index, factor):  # type: ignore[no-untyped-def]
    """Write the pivots and rows of the decomposition of gram [n, n], whose diagonal is `residual`,
    to index [n] and factor [n, n], until all residuals are at most `least`; return their number."""
    n = len(gram)
    for k in range(n):
        pivot = 0
        # symmetric arrays have ties, which rounding must not decide: the first one counts
        for j in range(1, n):
            if residual[j] > (1 + TIE) * residual[pivot]:
                pivot = j
        if residual[pivot] <= least:
            return k
        row = factor[k]
        for j in range(n):
            row[j] = gram[pivot, j]
        for i in range(k):
            weight = factor[i, pivot]
            for j in range(n):
                row[j] -= weight * factor[i, j]
        scale = 1 / math.sqrt(residual[pivot])
        for j in range(n):
            row[j] *= scale
            residual[j] -= row[j] * row[j]
        residual[pivot] = 0.0
        index[k] = pivot
    return n


def resampler(
    fine_m: np.ndarray, half_band: float, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the interpolation to samples at fine_m [n] (ascending, metres) from as few nodes as
    possible, such that every wave e^{jwx}, |w| ≤ half_band (rad/m), has a relative L2 error of at
    most `tolerance`: (nodes [n], metres; float32 weights [fine, n], fine values = weights · node
    values). If that saves nothing, the samples themselves are the nodes.

    The search begins at the number of degrees of freedom that such waves have at this error
    (Slepian 1983); fewer nodes are hardly ever enough.
    """
    extent = fine_m[-1] - fine_m[0]
    c = max(extent * half_band / 2, 1.0)
    intervals = max(int(2 / np.pi * c - 2 / np.pi**2 * np.log(c) * np.log(tolerance)), 1)
    while intervals + 1 < len(fine_m):
        nodes_m = fine_m[0] + extent * _crowded(intervals)
        weights = _weights(fine_m, nodes_m, half_band, tolerance)
        amplification = np.sqrt((weights**2).sum(axis=1).mean())
        if (
            amplification <= AMPLIFICATION
            and _misfit(fine_m, nodes_m, weights, half_band) <= tolerance
        ):
            return nodes_m, weights
        intervals += max(intervals // 60, 1)
    return fine_m, np.eye(len(fine_m), dtype=np.float32)


def resampler_for_channels(
    fine_m: np.ndarray,
    half_band: float,
    tolerance: float,
    channels: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Find the interpolation of `resampler` for a band that is so wide that single channels, too,
    have a relative L2 error of at most SINGLE · tolerance.

    What a single channel contributes to an image is a chirp, whose spectrum leaks out of the band
    ±half_band (rad/m). channels: function from places [n] on the axis to these contributions
    without the image's carrier, [n, lines, m] for m channels on some lines along the axis.
    """
    fine = channels(fine_m)
    while True:
        nodes_m, weights = resampler(fine_m, half_band, tolerance)
        regained = np.tensordot(weights, channels(nodes_m), 1)
        if (np.abs(regained - fine) ** 2).mean(axis=(0, 1)).max() <= (SINGLE * tolerance) ** 2:
            return nodes_m, weights
        half_band *= BAND_STEP


def _crowded(intervals: int) -> np.ndarray:
    """Return the positions of intervals + 1 nodes from 0 to 1, evenly spaced except near both ends.
    There they are closer, because interpolation lacks neighbours beyond an end, and denser nodes
    cost less than further nodes outside."""
    from_end = np.minimum(np.arange(intervals), np.arange(intervals)[::-1])
    nodes = np.concatenate([[0.0], np.cumsum(1 - CROWDING * np.exp(-from_end / REACH))])
    return nodes / nodes[-1]


def _misfit(
    fine_m: np.ndarray, nodes_m: np.ndarray, weights: np.ndarray, half_band: float
) -> float:
    """Return the largest relative L2 error, over fine_m, of interpolating a wave with a spatial
    frequency within ±half_band (rad/m) by these weights [fine, nodes]."""
    # crowded at the band's edge, where it is worst
    frequency = half_band * np.cos(np.linspace(0, np.pi / 2, PROBED))
    regained = weights @ np.exp(1j * np.multiply.outer(nodes_m - fine_m[0], frequency))
    wave = np.exp(1j * np.multiply.outer(fine_m - fine_m[0], frequency))
    return float(np.sqrt((np.abs(regained - wave) ** 2).mean(axis=0).max()))


def _weights(
    fine_m: np.ndarray, nodes_m: np.ndarray, half_band: float, tolerance: float
) -> np.ndarray:
    w = np.array([half_band])
    among = band_kernel(
        nodes_m[:, None], nodes_m[:, None], w
    ) + REGULARISATION * tolerance**2 * np.eye(len(nodes_m))
    across = band_kernel(nodes_m[:, None], fine_m[:, None], w)
    return np.ascontiguousarray(np.linalg.solve(among, across).T, np.float32)
