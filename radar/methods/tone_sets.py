"""Sets of tones: the error that they allow, and how probably noise puts a depth a maximum too far.

Of one scatterer with phase noise σ between two tones (variance σ²/2 each), N tones tell the depth to no better than the
Cramér–Rao bound

    σ_z = c σ / (4π √(2 Σ (f − f̄)²)).

A wrong depth Δ is chosen where its power exceeds the right one's. That is the decision between two signals of unknown
phase and correlation r = |Σ_f e^{j4πfΔ/c}|/N at the signal-to-noise ratio N/σ² (Stein, IEEE Trans. Inf. Theory 10
(1964) 43; Proakis, Digital Communications, 4th ed., eq. 5.4-36):

    P(Δ) = Q₁(a, b) − ½ e^{−(a²+b²)/2} I₀(ab),   a², b² = (N/2σ²)(1 ∓ √(1 − r²)).

The sum of P over the maxima of r beside the main one is about the wrap probability. It leaves out that the highest
point of a lobe is chosen, so that what it lets through is drawn as well: depths with noise, found by the method itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.special import ive
from scipy.stats import ncx2

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.alignment import align
from handbench.support.errors import HandbenchError

TRIED = 20_000  # sets, at most; where there are more, they are drawn
DRAWN, MOST_DRAWS = 60, 20_000  # sets that are drawn, and depths for each, at most
PER_CELL = 8  # depths a range cell, of the search for maxima


@dataclass(frozen=True)
class ToneSet:
    """tones_hz, the highest first; bound_m: of the error's 1σ; wraps: the share of drawn depths in another maximum."""

    tones_hz: tuple[float, ...]
    bound_m: float
    wraps: float


def bound_m(tones_hz: np.ndarray, noise_rad: float) -> np.ndarray:
    """The Cramér–Rao bound on σ_z of sets of tones [..., n], metres [...]."""
    spread_hz = np.sqrt(((tones_hz - tones_hz.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1))
    return np.asarray(SPEED_OF_LIGHT_M_S * noise_rad / (4 * np.pi * np.sqrt(2) * spread_hz))


def wrap_probability_of(tones_hz: np.ndarray, noise_rad: float, reach_m: float) -> float:
    """The probability that noise puts a depth of a search over ±reach_m into another maximum: the depth is anywhere in
    it, so that each maximum counts with the share of depths that it lies in reach of."""
    cell_m = SPEED_OF_LIGHT_M_S / (2 * np.ptp(tones_hz))
    beside_m = np.arange(cell_m / PER_CELL, 2 * reach_m, cell_m / PER_CELL)
    alike = np.abs(np.exp(4j * np.pi / SPEED_OF_LIGHT_M_S * np.outer(tones_hz, beside_m)).mean(axis=0))
    inner = alike[1:-1]
    peaks = 1 + np.flatnonzero((inner >= alike[:-2]) & (inner > alike[2:]) & (beside_m[1:-1] > cell_m / 2))
    share = 1 - beside_m[peaks] / (2 * reach_m)  # of each side
    return float(min(1.0, 2 * (share * mistaken(alike[peaks], len(tones_hz) / noise_rad**2)).sum()))


def mistaken(correlation: np.ndarray, snr: float) -> np.ndarray:
    """The probability [n] that of two signals of unknown phase and that correlation [n] the wrong one is stronger."""
    apart = np.sqrt(np.maximum(1 - correlation**2, 0.0))
    a2, b2 = snr / 2 * (1 - apart), snr / 2 * (1 + apart)
    ab = np.sqrt(a2 * b2)
    return np.asarray(ncx2.sf(b2, 2, a2) - 0.5 * ive(0, ab) * np.exp(ab - (a2 + b2) / 2))


def best_sets(
    count: int, band_hz: np.ndarray, pair_hz: float, noise_rad: float, reach_m: float, wraps: float, kept: int = 5
) -> list[ToneSet]:
    """The `kept` most accurate sets of `count` of the tones band_hz that wrap with at most that probability; fewer
    where there are no more. Each has both ends of the band and, if pair_hz > 0, the tone so far below the highest."""
    tones_hz = np.unique([*band_hz, band_hz.max() - pair_hz])[::-1]
    fixed = {0, len(tones_hz) - 1}
    if pair_hz:
        fixed.add(int(np.abs(tones_hz - (tones_hz[0] - pair_hz)).argmin()))
    free = [i for i in range(len(tones_hz)) if i not in fixed]
    if not 0 <= count - len(fixed) <= len(free) or count < 3:
        raise HandbenchError(
            f"tones: {count} of {len(tones_hz)} cannot be chosen; expected {max(3, len(fixed))} or more"
        )
    tried = np.unique(np.sort([[*fixed, *more] for more in _choices(free, count - len(fixed))], axis=1), axis=0)
    bounds_m = bound_m(tones_hz[tried], noise_rad)
    found: list[ToneSet] = []
    drawn = 0
    for i in np.argsort(bounds_m, kind="stable"):
        if len(found) == kept or drawn == DRAWN:
            break
        if wrap_probability_of(tones_hz[tried[i]], noise_rad, reach_m) > wraps:
            continue
        drawn += 1
        one = tone_set(tones_hz[tried[i]], noise_rad, reach_m, wraps)
        if one.wraps <= wraps:
            found.append(one)
    return found


def tone_set(tones_hz: np.ndarray, noise_rad: float, reach_m: float, wraps: float) -> ToneSet:
    """A set with its bound, and its wraps by as many draws as tell a share of about `wraps`."""
    share = drawn_wraps(tones_hz, noise_rad, reach_m, max(2000, round(min(10 / wraps, MOST_DRAWS))))
    return ToneSet(tuple(map(float, tones_hz)), float(bound_m(tones_hz, noise_rad)), share)


def drawn_wraps(tones_hz: np.ndarray, noise_rad: float, reach_m: float, draws: int = 4000, seed: int = 0) -> float:
    """The share of random depths within ±reach_m that the method itself, `align`, puts more than half a range cell off:
    a check of `wrap_probability_of`."""
    random = np.random.default_rng(seed)
    offs_m = random.uniform(-reach_m, reach_m, draws)
    noise = (
        noise_rad * np.sqrt(0.5) * (random.standard_normal((2, len(tones_hz), draws)) * [[[1.0]], [[1j]]]).sum(axis=0)
    )
    images = np.exp(-4j * np.pi / SPEED_OF_LIGHT_M_S * np.outer(tones_hz, offs_m)) + noise
    found = align(images, tones_hz, np.full(draws, 2.0), reach_m)
    return float(np.mean(np.abs(found.shift_m - offs_m) > SPEED_OF_LIGHT_M_S / (4 * np.ptp(tones_hz))))


def _choices(free: list[int], more: int) -> Iterator[tuple[int, ...]]:
    """All ways to choose, or TRIED drawn ones."""
    if comb(len(free), more) <= TRIED:
        return combinations(free, more)
    random = np.random.default_rng(0)
    return (tuple(random.choice(free, more, replace=False)) for _ in range(TRIED))
