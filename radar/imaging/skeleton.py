"""Skeletons of band-limited families: a few members that carry all the others (interpolative decomposition)."""

from __future__ import annotations

import numba
import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import j0

TIE = 1e-6  # relative difference below which two members are as good


def skeleton(gram: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Pivoted Cholesky of a positive semi-definite kernel [n, n] with unit diagonal until no member is further than
    `tolerance` from the span of those chosen.

    Returns indices s [k] and real weights X [k, n] with member_i ≈ Σ_m X[m, i] · member_s[m].
    """
    index, factor = _pivoted_cholesky(np.ascontiguousarray(gram, np.float64), tolerance**2)
    return index, solve_triangular(factor[:, index], factor)  # G_ss⁻¹ G_s,all with G = factorᵀ factor


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


@numba.njit(nogil=True, cache=True, fastmath={"contract", "reassoc", "nsz"})
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
