"""Depth where the tones agree: the shift along z at which a few tones' images have one phase.

The aperture focuses on a smooth surface's mirror image and not on the surface, so that the strongest voxel lies before
or behind it; the delay does not care. An image formed at z_p of a scatterer at z has the phase k_f (z_p − z) and one
that all tones share, with k_f = 2πf/c · d(|p − t| + |p − r|)/dz averaged over the antennas. Where the paths of the
scatterer's neighbourhood are those of one depth, the power of the sum over N tones, with the shift Δ,

    P(Δ) = |Σ_f O_f e^{jk_f Δ}|² / (N Σ_f |O_f|²),

is their coherence, 1 at Δ = z − z_p: its maximum is the maximum-likelihood depth of one scatterer in white noise (Rife
& Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591). What the phases differ by from a line, variance s² a tone, gives the
depth the variance s² / Σ_f (k_f − k̄)², the Cramér–Rao bound with s² measured. The noise's power, (1 − P) Σ |O_f|² over
N − 1 degrees of freedom, gives the odds e^{(N−1)(P₁−P₂)/(1−P₁)} of the highest maximum against the second.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.depth_uncertainty import beside_nearer, speckle_spread_m
from handbench.radar.methods.fsk_config import AgreementConfig
from handbench.radar.methods.smoothing import masked_mean

STEPS = 16  # per range cell, of the search
ALIGNED = 0.9  # coherence below which two depths share a pixel,
NONE = 0.8  # and below which a pixel has none
TINY, MANY = 1e-12, 500.0  # least of 1 − P, and most of the exponent
POLISHES = 2  # Gauss–Newton steps from the search's maximum


class Alignment(NamedTuple):
    """shift_m, its standard deviation sigma_m, coherence P and the probability `other` that the second maximum of P is
    the right one, each [n]."""

    shift_m: np.ndarray
    sigma_m: np.ndarray
    coherence: np.ndarray
    other: np.ndarray


def align(images: np.ndarray, frequencies_hz: np.ndarray, rise: np.ndarray, reach_m: float | None = None) -> Alignment:
    """The shifts, within ±reach_m, that align images [f, n] of the tones [f], f ≥ 3; rise [n]: of the path, per metre
    along z. Without a reach: a range cell c/2B, or half of what evenly spaced tones repeat after."""
    k = 2 * np.pi * frequencies_hz[:, None] / SPEED_OF_LIGHT_M_S * rise
    cell_m = SPEED_OF_LIGHT_M_S / (2 * np.ptp(frequencies_hz))
    if reach_m is None:
        reach_m = cell_m * min(1.0, (len(frequencies_hz) - 1) / 2)
    tried_m = np.linspace(-reach_m, reach_m, 1 + 2 * int(np.ceil(STEPS * reach_m / cell_m)))
    power = np.stack([np.abs(_sum(_turned(images, k, there_m))) ** 2 for there_m in tried_m])
    shift_m = np.where(power.any(axis=0), tried_m[power.argmax(axis=0)], 0.0)
    beside = np.abs(tried_m[:, None] - shift_m) * rise / 2 > cell_m / 2
    second = np.where(beside, power, 0.0).max(axis=0)
    weight = np.abs(images).astype(np.float64) ** 2
    total = np.where(power.any(axis=0), weight.sum(axis=0), np.inf)
    from_mean = k - (weight * k).sum(axis=0) / total
    leverage = (weight * from_mean**2).sum(axis=0) / total  # Σ (k − k̄)² / N
    turned = _turned(images, k, shift_m)
    for _ in range(POLISHES):
        slope = (weight * from_mean * _residual(turned)).sum(axis=0) / total
        shift_m = shift_m - np.divide(slope, leverage, out=np.zeros(len(rise)), where=leverage > 0)
        turned = _turned(images, k, shift_m)
    variance = (weight * _residual(turned) ** 2).sum(axis=0) / total / (len(images) - 2)
    sigma_m = np.sqrt(np.divide(variance, leverage, out=np.full(len(rise), np.inf), where=leverage > 0))
    first, second = np.abs(_sum(turned)) ** 2 / (len(images) * total), second / (len(images) * total)
    odds = (len(images) - 1) * (first - second) / np.maximum(1 - first, TINY)
    return Alignment(shift_m, sigma_m, first, 1 / (1 + np.exp(np.clip(odds, -MANY, MANY))))


def agreed(depth: DepthMap, coherence: np.ndarray, bandwidth_hz: float, config: AgreementConfig) -> DepthMap:
    """An aligned depth map of that coherence [ny, nx] without what is no depth, filtered. σ is that of the tones and,
    in quadrature, what the filter takes away: speckle, of which the tones of one pixel do not tell."""
    none, grid = coherence < NONE, PixelGrid(depth.x_m, depth.y_m)
    reach_px = [
        int(config.edge_m / np.diff(axis).mean() + 1e-6) if len(axis) > 1 else 0 for axis in (grid.y_m, grid.x_m)
    ]
    half_cell_m = SPEED_OF_LIGHT_M_S / (4 * bandwidth_hz)
    hidden = beside_nearer(np.where(none, np.nan, depth.z_m), reach_px, half_cell_m)
    dropped = (none | hidden) & config.drop_doubtful
    z_m, own_m = (np.where(dropped, np.nan, told) for told in (depth.z_m, np.asarray(depth.sigma_m)))
    power = 10 ** (depth.amplitude_db.astype(np.float64) / 10)
    speckle_m = speckle_spread_m(grid.points_m(z_m), np.sqrt(power), config.fine_filter_px, config.spread_px)
    wrapped = np.isfinite(z_m) & (np.asarray(depth.wrapped) | (coherence < ALIGNED) | hidden)
    smooth_m = masked_mean(z_m, config.fine_filter_px, power)
    return replace(depth, z_m=smooth_m, sigma_m=np.hypot(speckle_m, own_m), wrapped=wrapped)


def _turned(images: np.ndarray, k: np.ndarray, shift_m: np.ndarray | float) -> np.ndarray:
    """Images [f, n] as they would be at another depth."""
    return np.asarray(images * np.exp(1j * k * shift_m))


def _sum(images: np.ndarray) -> np.ndarray:
    return np.asarray(images.sum(axis=0))


def _residual(images: np.ndarray) -> np.ndarray:
    """Phases [f, n] about that of the sum."""
    return np.angle(images * np.conj(_sum(images)))
