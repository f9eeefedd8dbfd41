"""Skeletons of band-limited families: a few members that carry all the others (interpolative decomposition)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular


def skeleton(gram: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Pivoted Cholesky of a positive semi-definite kernel [n, n] with unit diagonal until no member is further than
    `tolerance` from the span of those chosen.

    Returns indices s [k] and real weights X [k, n] with member_i ≈ Σ_m X[m, i] · member_s[m].
    """
    n = len(gram)
    residual = np.diag(gram).astype(np.float64).copy()
    factor = np.zeros((0, n))
    chosen: list[int] = []
    while len(chosen) < n and residual.max() > tolerance**2:
        pivot = int(np.argmax(residual))
        row = (gram[pivot] - factor[:, pivot] @ factor) / np.sqrt(residual[pivot])
        factor = np.vstack([factor, row])
        residual -= row**2
        residual[pivot] = 0.0
        chosen.append(pivot)
    index = np.array(chosen)
    weights = solve_triangular(factor[:, index], factor)  # G_ss⁻¹ G_s,all with G = factorᵀ factor
    return index, weights
