"""How far a depth may be trusted, from the images that gave it.

White noise and speckle have no preferred phase: one quadrature of what they add to O_b·conj(O_a) turns its phase, which
moves the depth; the other, of equal size, changes its amplitude, which ought to be the same at neighbouring tones. The
amplitudes thus show what the phases suffered. With ρ = (|O_b| − |O_a|) / ½(|O_b| + |O_a|) as large as the error of φ,

    σ_z = c / (4πΔf) · σ_φ,   σ_φ = rms(ρ·A) / A   (σ_φ ∝ 1/A: noise is as strong where the echo is weak),

the mean square taken half over a window of a few resolution cells, since speckle is local, and half over the whole
target, since a window holds few independent values. Nothing is assumed about the noise, and nothing is fitted.
"""

from __future__ import annotations

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.methods.smoothing import masked_mean

FEW = 100  # pixels that may be but a few resolution cells: their median would hide the noise with the gain
TINY_M = 1e-150  # its square is still a number: a point known exactly, exactly between two periods, may be in either
NOISE_PASSES = 0.01  # share of noise's pixels that may pass for an echo's
SIDELOBE = 0.05  # of sinc², the pulse of an even band: 0.047
UNRELATED_RAD = 2 * np.sqrt(np.pi - 3)  # rms of ρ between images that share nothing (Rayleigh amplitudes): its most


def quadrature_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """cρ / (4πΔf): Δz of `radar.methods.fsk.depth_step_m` with the amplitudes' relative difference ρ in place of φ;
    metres."""
    b, a = np.abs(image_b).astype(np.float64), np.abs(image_a).astype(np.float64)
    with np.errstate(invalid="ignore"):  # an image of zeros has no confidence
        ratio = 2 * (b - a) / (b + a)
    return SPEED_OF_LIGHT_M_S * ratio / (4 * np.pi * difference_hz)


def spread_m(quadrature_m: np.ndarray, amplitude: np.ndarray, window_px: int) -> np.ndarray:
    """Predicted 1σ of the depth [ny, nx], metres, from its quadrature step and amplitude [ny, nx]; NaN off target.

    The median of many pixels is taken out first: the tones may differ in gain.
    """
    known = np.isfinite(quadrature_m)
    if not known.any():
        return quadrature_m
    power, sigma_m = np.full(known.shape, np.nan), np.full(known.shape, np.nan)
    gain_m = np.median(quadrature_m[known]) if np.count_nonzero(known) > FEW else 0.0
    power[known] = ((quadrature_m[known] - gain_m) * amplitude[known]) ** 2
    local = masked_mean(power, window_px)[known]
    sigma_m[known] = np.sqrt((local + power[known].mean()) / 2) / amplitude[known]
    return sigma_m


def incoherent(sigma_m: np.ndarray, ambiguity_m: np.ndarray | float) -> np.ndarray:
    """Whether a phase that tells depths within ±ambiguity is noise: three standard deviations σ fill its circle.

    An amplitude tells σ_φ = πσ_z/a up to that of unrelated images only, σ₀; s = σ_φ/√(1 − (σ_φ/σ₀)²) undoes that, and
    3s > π where σ_φ exceeds (π/3)σ₀/√((π/3)² + σ₀²) = 0.61.
    """
    most_rad = np.pi / 3 * UNRELATED_RAD / np.hypot(np.pi / 3, UNRELATED_RAD)
    return sigma_m > most_rad / np.pi * ambiguity_m


def least_coherence(count: int, known: int, range_cells: float) -> float:
    """What |Σ O|² / (N Σ |O|²) of the N = count tones' images O must reach at a pixel's strongest voxel to be an
    echo's: that of one depth has 1, noise 1/N on average. Of Σ |O|², n = `known` of the tones tell.

    Of noise, N times the ratio is F-distributed with 2 and 2n degrees of freedom, so that the strongest of K depths,
    two a range cell of the volume, exceeds x in a share K (1 + Nx/n)^(−n) of the pixels: NOISE_PASSES. An echo from
    outside the volume is seen by its range sidelobes: SIDELOBE at most.
    """
    depths = 1 + 2 * range_cells
    return max(known / count * ((depths / NOISE_PASSES) ** (1 / known) - 1), SIDELOBE)


def wrap_probability(step_m: np.ndarray, sigma_m: np.ndarray, ambiguity_m: np.ndarray | float) -> np.ndarray:
    """Probability that a phase step, known within ±ambiguity only, belongs one period 2a further on.

    The point's error before the step is N(0, σ): the odds of |Δz| against 2a − |Δz| are exp(−2a(a − |Δz|)/σ²).
    """
    variance_m2 = np.maximum(sigma_m, TINY_M) ** 2
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(2 * ambiguity_m * (ambiguity_m - np.abs(step_m)) / variance_m2))
