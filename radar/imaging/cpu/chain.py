"""Samples down the tree and up again.

Samples are float32 planes [tone, re/im, transmitter, receiver], so that all products are real matrix products (faster
than complex ones here). Descending multiplies by the parent-to-child phases and by the real skeleton weights; ascending
is its exact adjoint: conjugate phases, transposed weights, in reverse order.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from radar.imaging.cpu.steering import cis_turns

FAST: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"contract", "reassoc", "nsz"},
    "error_model": "numpy",
}


def planes(samples: np.ndarray) -> np.ndarray:
    """Complex samples [k, t, r] (or a scan's [k, n]) → float32 [k, 2, t, r or 1]."""
    apart = np.ascontiguousarray(np.stack([samples.real, samples.imag], axis=1), np.float32)
    return apart[..., None] if apart.ndim == 3 else apart


def complex_samples(apart: np.ndarray) -> np.ndarray:
    """Planes [k, 2, t, r] → complex64 [k, t, r]."""
    return apart[:, 0] + np.complex64(1j) * apart[:, 1]


@numba.njit(**FAST)
def descend(samples, turns_per_m, shift_a, shift_b, tone_weights, weights_a, weights_b):  # type: ignore[no-untyped-def]
    """Samples [k, 2, a, b] of a parent → those of its child. Empty weights leave their axis as it is."""
    mixed = _mix(tone_weights, turn(samples, turns_per_m, shift_a, shift_b, np.float32(1.0)))
    return _apply(weights_b, _apply(weights_a, mixed))  # each application swaps the antenna axes: twice restores them


@numba.njit(**FAST)
def ascend(samples, turns_per_m, shift_a, shift_b, tone_weights, weights_a, weights_b):  # type: ignore[no-untyped-def]
    """The adjoint of `descend`: a child's samples → what they add to its parent's."""
    spread = _apply(weights_b.T.copy(), _apply(weights_a.T.copy(), samples))
    return turn(_mix(tone_weights.T.copy(), spread), turns_per_m, shift_a, shift_b, np.float32(-1.0))


@numba.njit(**FAST)
def turn(samples, turns_per_m, shift_a, shift_b, sign):  # type: ignore[no-untyped-def]
    """samples · exp(±j2πf(shift_a + shift_b)/c)."""
    out = np.empty_like(samples)
    tones, _, n_a, n_b = samples.shape
    b_re, b_im = np.empty(n_b, np.float32), np.empty(n_b, np.float32)
    for m in range(tones):
        for b in range(n_b):
            b_re[b], b_im[b] = cis_turns(turns_per_m[m] * shift_b[b])
        for a in range(n_a):
            a_re, a_im = cis_turns(turns_per_m[m] * shift_a[a])
            for b in range(n_b):
                re, im = a_re * b_re[b] - a_im * b_im[b], sign * (a_re * b_im[b] + a_im * b_re[b])
                out[m, 0, a, b] = samples[m, 0, a, b] * re - samples[m, 1, a, b] * im
                out[m, 1, a, b] = samples[m, 0, a, b] * im + samples[m, 1, a, b] * re
    return out


@numba.njit(**FAST)
def _mix(weights, samples):  # type: ignore[no-untyped-def]
    if weights.size == 0:
        return samples
    tones, _, n_a, n_b = samples.shape
    return np.dot(weights, samples.reshape(tones, 2 * n_a * n_b)).reshape(len(weights), 2, n_a, n_b)


@numba.njit(**FAST)
def _apply(weights, samples):  # type: ignore[no-untyped-def]
    """Real weights [n, a] on the first antenna axis of samples [k, 2, a, b], which then swaps with the second:
    [k, 2, b, n]."""
    tones, _, n_a, n_b = samples.shape
    if weights.size == 0:
        n, flat = n_a, np.empty((n_a, tones * 2 * n_b), np.float32)
    else:
        n, flat = len(weights), np.empty((n_a, tones * 2 * n_b), np.float32)
    for m in range(2 * tones):
        for a in range(n_a):
            for b in range(n_b):
                flat[a, m * n_b + b] = samples[m // 2, m % 2, a, b]
    if weights.size != 0:
        flat = np.dot(weights, flat)
    out = np.empty((tones, 2, n_b, n), np.float32)
    for m in range(2 * tones):
        for b in range(n_b):
            for i in range(n):
                out[m // 2, m % 2, b, i] = flat[i, m * n_b + b]
    return out
