"""The scatter of depths over repeated frames, which is the precision of a method."""

from collections.abc import Sequence

import numpy as np


def strongest_scatterer_z_m(z_m: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Return the depth [n], metres, of the strongest scatterer in each repeated frame, from which
    the precision is computed.
    z_m, amplitude [n, ny, nx]: depths, metres, and linear amplitudes. The same pixel is used in all
    frames: of the pixels observed in every frame, the one with the largest mean amplitude. (The
    strongest pixel of each frame could jump between glints of nearly equal strength; the distance
    between these would then be measured.) NaN if there is no such pixel."""
    steady = np.isfinite(z_m).all(axis=0) & ~np.isnan(amplitude).any(axis=0)
    if not steady.any():
        return np.full(len(z_m), np.nan)
    strongest = np.argmax(np.where(steady, amplitude.mean(axis=0), -np.inf))
    return z_m.reshape(len(z_m), -1)[:, strongest]


def precision_mm(strongest_z_m: Sequence[np.ndarray]) -> float | None:
    """Compute the precision, mm: the standard deviation over the repeats, averaged over the hands.
    strongest_z_m: for each hand, the depth of its strongest scatterer in every repeat [n_repeats],
    metres. None if a hand has fewer than two usable repeats."""
    hands = usable_repeats(strongest_z_m)
    return float(1e3 * np.mean([deviation(z) for z in hands])) if hands else None


def relative_precision_percent(strongest_z_m: Sequence[np.ndarray]) -> float | None:
    """Compute the relative precision, 100 (1 − precision / mean depth) %, from the same depths."""
    hands = usable_repeats(strongest_z_m)
    distance_m = np.mean([z.mean() for z in hands]) if hands else 0.0
    if not distance_m:
        return None
    return float(100 * (1 - np.mean([deviation(z) for z in hands]) / distance_m))


def deviation(values: np.ndarray) -> float:
    """Return the standard deviation (n − 1) of `values` [n ≥ 2]; exactly 0 if all values are
    equal."""
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0 else 0.0


def usable_repeats(strongest_z_m: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Remove the repeats in which nothing was imaged (NaN) from the depths of each hand.
    strongest_z_m: for each hand, depths [n_repeats]. Returns an empty list if any hand keeps fewer
    than two, because a mean over fewer hands would be another figure."""
    hands = [
        z[np.isfinite(z)] for z in (np.asarray(hand, dtype=np.float64) for hand in strongest_z_m)
    ]
    return hands if all(len(z) > 1 for z in hands) else []


def mean_deviation(strongest_z_m: Sequence[np.ndarray]) -> tuple[float, float] | None:
    """Return the standard deviation of depth over repeats, mm, averaged over the hands, and its
    degrees of freedom.
    strongest_z_m: for each hand, depths [n_repeats], metres. Degrees of freedom are ν = (Σ s)² / Σ
    (s²/ν_hand) (Welch–Satterthwaite). None if a hand has fewer than two usable repeats."""
    hands = usable_repeats(strongest_z_m)
    if not hands:
        return None
    each_mm = np.array([1e3 * deviation(z) for z in hands])
    freedom = np.array([len(z) - 1 for z in hands])
    if not each_mm.any():
        return 0.0, float(freedom.sum())
    return float(each_mm.mean()), float(each_mm.sum() ** 2 / (each_mm**2 / freedom).sum())
