"""How far a figure can be trusted: seeded confidence intervals that respect what is independent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from bench.metrics import ErrorMap, Values, pool, usable_repeats

BLOCK_M = 0.015  # three lateral resolutions of the paper's aperture: errors further apart share no speckle
CAPTURES_TO_RESAMPLE = 5  # fewer captures say nothing about other captures: the interval is then given these


class Interval(NamedTuple):
    """Confidence interval, in the unit of its figure."""

    low: float
    high: float


class Blocks(NamedTuple):
    """The reference's pixels of several captures, in spatial blocks. error_m, reference_z_m, block: [pixel];
    per_capture: number of blocks of each capture (the blocks are numbered capture after capture)."""

    error_m: np.ndarray
    reference_z_m: np.ndarray
    block: np.ndarray
    per_capture: list[int]


def pooled_intervals(
    maps: Sequence[ErrorMap],
    seed: int = 0,
    resamples: int = 1000,
    block_m: float = BLOCK_M,
    level: float = 0.95,
) -> dict[str, Interval]:
    """Metric → percentile bootstrap interval of the pooled metrics of `maps`.

    Neighbouring pixels err together, so whole blocks of block_m × block_m are drawn with replacement within
    each capture, and the captures themselves too when there are at least five (Davison & Hinkley 1997,
    chapters 2, 3 and 8). Widened where it would miss the point estimate. The interval of a maximum ends at the
    maximum that was seen: no resample can show a larger one. Without two blocks there is no interval: {}.
    """
    blocks = _cut(maps, block_m)
    if sum(blocks.per_capture) < 2 or not np.isfinite(blocks.error_m).any():
        return {}
    counts = _draws(blocks.per_capture, resamples, np.random.default_rng(seed))
    return _intervals(_resampled(blocks, counts), pool(maps), level)


def _cut(maps: Sequence[ErrorMap], block_m: float) -> Blocks:
    errors, references, blocks, per_capture = [], [], [], []
    for m in maps:
        surface = np.isfinite(m.reference_z_m)
        names, label = np.unique(block_numbers(m, block_m)[surface], return_inverse=True)
        errors.append(m.error_m[surface])
        references.append(m.reference_z_m[surface])
        blocks.append(label + sum(per_capture))
        per_capture.append(len(names))
    if not maps:
        return Blocks(np.empty(0), np.empty(0), np.empty(0, int), [])
    return Blocks(np.concatenate(errors), np.concatenate(references), np.concatenate(blocks), per_capture)


def block_numbers(m: ErrorMap, block_m: float = BLOCK_M) -> np.ndarray:
    """The number of the spatial block in which each pixel [ny, nx] lies."""
    column, row = (np.floor((axis - axis.min()) / block_m + 1e-9).astype(int) for axis in (m.x_m, m.y_m))
    return row[:, None] * (column.max() + 1) + column


def _draws(per_capture: list[int], resamples: int, rng: np.random.Generator) -> np.ndarray:
    """How often each resample holds each block [resamples, n_blocks]."""
    per_capture = [n for n in per_capture if n]
    captures = len(per_capture)
    picks = np.ones((resamples, captures), dtype=int)
    if captures >= CAPTURES_TO_RESAMPLE:
        picks = rng.multinomial(captures, np.full(captures, 1 / captures), size=resamples)
    return np.hstack([
        rng.multinomial(picks[:, c] * n, np.full(n, 1 / n)) for c, n in enumerate(per_capture)
    ])


def _resampled(blocks: Blocks, counts: np.ndarray) -> dict[str, np.ndarray]:
    """Each metric of each resample [resamples]: sums over blocks, weighted by how often each was drawn."""
    n_blocks = counts.shape[1]
    observed = np.isfinite(blocks.error_m)
    error_m, reference_z_m, block = blocks.error_m[observed], blocks.reference_z_m[observed], blocks.block[observed]
    absolute_m = np.abs(error_m)

    def total(values: np.ndarray, of: np.ndarray = block) -> np.ndarray:
        return counts @ np.bincount(of, values, minlength=n_blocks)

    largest_m = np.full(n_blocks, -np.inf)
    np.maximum.at(largest_m, block, absolute_m)
    n = total(np.ones_like(error_m)).astype(float)
    n[n == 0] = np.nan  # a resample without an observed pixel has no mean
    median_m, p95_m = _quantiles(absolute_m, block, counts, (0.5, 0.95))
    return {
        "mae_mm": 1e3 * total(absolute_m) / n,
        "max_mm": 1e3 * np.where(counts > 0, largest_m, -np.inf).max(axis=1),
        "rmse_mm": 1e3 * np.sqrt(total(error_m**2) / n),
        "median_mm": 1e3 * median_m,
        "p95_mm": 1e3 * p95_m,
        "bias_mm": 1e3 * total(error_m) / n,
        "relative_accuracy_percent": 100 * (1 - (total(absolute_m) / n) / (total(reference_z_m) / n)),
        "completeness_percent": 100 * total(observed, blocks.block) / total(observed >= 0, blocks.block),
    }


def _quantiles(
    values: np.ndarray, block: np.ndarray, counts: np.ndarray, shares: tuple[float, ...]
) -> np.ndarray:
    """Quantiles [share, resample] of `values` repeated as `counts` says; linear between order statistics."""
    order = np.argsort(values)
    values, block = values[order], block[order]
    result = np.full((len(shares), len(counts)), np.nan)
    for r, count in enumerate(counts):
        upto = np.cumsum(count[block])
        if upto[-1] == 0:
            continue
        position = np.array(shares) * (upto[-1] - 1)
        below, above = (values[np.searchsorted(upto, f(position), side="right")] for f in (np.floor, np.ceil))
        result[:, r] = below + (position % 1) * (above - below)
    return result


def _intervals(resampled: dict[str, np.ndarray], estimate: Values, level: float) -> dict[str, Interval]:
    intervals = {}
    for key, values in resampled.items():
        low, high = np.quantile(values[np.isfinite(values)], [(1 - level) / 2, (1 + level) / 2])
        intervals[key] = Interval(float(min(low, estimate[key])), float(max(high, estimate[key])))
    return intervals


def precision_interval(strongest_z_m: Sequence[np.ndarray], level: float = 0.95) -> Interval | None:
    """χ² interval, in mm, of `metrics.precision`; None where that is None.

    ν s²/σ² is χ² with ν degrees of freedom for normal errors. For a mean of several hands' deviations
    ν = (Σ s)² / Σ (s²/ν_hand), the value that gives the mean its variance (Welch–Satterthwaite).
    """
    hands = usable_repeats(strongest_z_m)
    if not hands:
        return None
    deviations_mm = np.array([1e3 * np.std(z, ddof=1) for z in hands])
    freedom = np.array([len(z) - 1 for z in hands])
    if not deviations_mm.any():
        return Interval(0.0, 0.0)
    nu = deviations_mm.sum() ** 2 / (deviations_mm**2 / freedom).sum()
    tails = np.array([(1 - level) / 2, (1 + level) / 2])
    return Interval(*map(float, deviations_mm.mean() * np.sqrt(nu / chdtri(nu, tails))))


def median_interval(
    values: np.ndarray, seed: int = 0, resamples: int = 1000, level: float = 0.95
) -> Interval | None:
    """Bootstrap interval of the median of independent `values` [n]; None for fewer than three."""
    if len(values) < 3:
        return None
    drawn = np.random.default_rng(seed).choice(values, size=(resamples, len(values)))
    low, high = np.quantile(np.median(drawn, axis=1), [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(low), float(high))
