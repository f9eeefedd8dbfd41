"""Standard deviation and wrap flags of FSK's depths, from the images that gave the depths.

Noise and speckle are circular: their quadrature component turns the phase of O_b·conj(O_a), which
moves the depth, and their in-phase component, equally strong, changes its amplitude. So amplitude
differences between tones estimate the error of the phase (`quadrature_step_m`), and

    σ = √((⟨q²A²⟩_window + ⟨q²A²⟩_map) / 2) / A

is the standard deviation of a depth with the amplitude A whose quadrature step is q: noise is as
strong where the echo is weak, speckle is local, and a window has few independent values. Speckle
that turns all tones of a pixel by one phase does not show in q; it is estimated from the part of
the depths that the last filter removes, and the larger σ counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, reach_hz
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk import SHARPER, Fsk, FskStep, fsk
from handbench.radar.methods.pixels import Pixels

# below so many pixels, a few resolution cells, no median is subtracted: it would hide the noise
FEW = 100
SPREAD_PX = 9  # window over which the mean square of errors is averaged: two resolution cells
WRAP_PROBABILITY = 0.1  # that a pixel is a period off, above which it is flagged
# a filter that moves a pixel by more has mixed two surfaces
OTHER_SURFACE_M = 0.003
# least σ, whose square is still a number
TINY_M = 1e-150
# σ over the ambiguity from which a phase is only noise: three true standard deviations exceed half
# a turn (amplitudes of unrelated images differ less than their phases)
NOISE = 0.1945
# share of such pixels above which the whole target is noise (noise only: 0.4 to 0.6)
NOISY = 0.25
TAILS = 1.15  # the noise of velocities has wider tails than a Gaussian of its estimated σ
OTHER_LINE_OF_SIGHT = 0.014  # share of the velocity


def quadrature_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Compute the quadrature step q = cρ / (4πΔf) of two images, metres: the depth step with the
    relative difference ρ = (|O_b| − |O_a|) / ½(|O_b| + |O_a|) of the amplitudes in place of the
    phase φ. difference_hz: Δf = f_b − f_a."""
    b, a = np.abs(image_b).astype(np.float64), np.abs(image_a).astype(np.float64)
    with np.errstate(invalid="ignore"):  # an image of zeros has no confidence
        ratio = 2 * (b - a) / (b + a)
    return SPEED_OF_LIGHT_M_S * ratio / (4 * np.pi * difference_hz)


def spread_m(
    error_m: np.ndarray, amplitude: np.ndarray, pixels: Pixels, window_px: int = SPREAD_PX
) -> np.ndarray:
    """Compute σ = √((⟨q²A²⟩_window + ⟨q²A²⟩_map) / 2) / A [n], metres, from the errors q (error_m)
    and amplitudes A of n pixels, NaN where q is. Of many pixels, the
    median of q is subtracted first, since the tones may differ in gain. window_px: width of the
    window."""
    on = np.isfinite(error_m)
    if not on.any():
        return np.full(len(on), np.nan)
    gain_m = np.median(error_m[on]) if np.count_nonzero(on) > FEW else 0.0
    power = ((error_m - gain_m) * amplitude) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (pixels.means(power, window_px) + power[on].mean()) / 2
        return np.asarray(np.sqrt(mean) / amplitude)


def speckle_m(
    z_m: np.ndarray, filtered_m: np.ndarray, amplitude: np.ndarray, pixels: Pixels
) -> np.ndarray:
    """Compute the standard deviation (1σ) of depths z_m [n] of pixels by speckle, metres,
    from the part that a filter removes. filtered_m: the filtered depths."""
    removed_m = np.clip(z_m - filtered_m, -OTHER_SURFACE_M, OTHER_SURFACE_M)
    return spread_m(removed_m, amplitude, pixels)


def wrap_probability(
    step_m: np.ndarray, sigma_m: np.ndarray, ambiguity_m: np.ndarray | float
) -> np.ndarray:
    """Compute the probability P = 1 / (1 + exp(2a(a − |Δz|)/σ²)) that a depth step Δz = step_m is
    wrong by one period 2a, because it comes from a phase that is unambiguous only within ±a =
    ambiguity_m: the odds of |Δz| against 2a − |Δz| for an error N(0, σ) of the depth before."""
    variance_m2 = np.maximum(sigma_m, TINY_M) ** 2
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(2 * ambiguity_m * (ambiguity_m - np.abs(step_m)) / variance_m2))


def fsk_with_uncertainty(capture: RadarCapture, config: Fsk, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame by an FSK method, with predicted 1σ and flags for pixels
    that may be wrong. With config.drop_doubtful, flagged pixels become NaN after each imaging
    step."""
    wrapped = error_m = np.zeros(0)
    last: FskStep | None = None

    def add(step: FskStep) -> np.ndarray:
        nonlocal wrapped, error_m, last
        if last is None:
            wrapped = doubtful_on_plane(step)
        else:
            if len(step.images) > len(last.images):
                error_m = last.filtered(error_m)
            wrapped = wrapped | may_wrap(step, spread_m(error_m, last.amplitude, last.pixels))
        # quadrature steps of the last imaging step, filtered like its depths
        last, error_m = step, quadrature_m(step)
        if not config.drop_doubtful:
            return step.z_m
        error_m[wrapped] = np.nan
        return np.where(wrapped, np.nan, step.z_m)

    depth, steps = fsk(capture, config, frame, on_step=add)
    step = steps[-1]
    sigma_m = np.fmax(
        spread_m(step.filtered(error_m), step.amplitude, step.pixels),
        speckle_m(step.z_m, depth.z_m.ravel()[step.pixels.index], step.amplitude, step.pixels),
    )
    if len(step.again):
        depth = replace(depth, velocity_sigma_m_s=velocity_sigma_m_s(step, depth))
    pixels = step.pixels
    return replace(depth, sigma_m=pixels.on_map(sigma_m), wrapped=pixels.on_map(wrapped, 0) > 0)


def quadrature_m(step: FskStep) -> np.ndarray:
    """Compute the quadrature steps [n] of an imaging step's pixels, averaged over tones and scaled
    like its depth correction, metres."""
    return np.asarray(step.steps_m(quadrature_step_m).mean(axis=0) * step.factor)


def half_period_m(step: FskStep) -> float:
    """Return the unambiguous range ±c / 4Δf, metres on the axis, of the last tone's depths."""
    tones_hz = step.echoes.frequencies_hz[: len(step.images)]
    return SPEED_OF_LIGHT_M_S / (4 * reach_hz(tones_hz.tolist()))


def doubtful_on_plane(step: FskStep) -> np.ndarray:
    """Flag pixels of the first imaging step, which images one plane: boolean [n]. Flagged are
    noise, depths behind the array, and all pixels if the target seems to be one period before or
    behind the plane, where the pair of tones has the same phases.

    That is so if the image of the plane there has a clearly higher peak. A farther plane's peak is
    divided by its distance first, since its wider resolution cells collect more echoes.
    """
    sigma_m = spread_m(quadrature_m(step), step.amplitude, step.pixels)
    noise = sigma_m > NOISE * half_period_m(step) * step.factor
    if np.count_nonzero(noise) > NOISY * len(noise):  # the rest are peaks of the noise
        noise[:] = True
    z_m, peak, period_m = step.formed_m[0], step.amplitude.max(), 2 * half_period_m(step)
    elsewhere = any(
        step.echoes.strongest(there_m).amplitude.max() > SHARPER * peak * max(1, there_m / z_m)
        for there_m in (z_m - period_m, z_m + period_m)
        if there_m > 0
    )
    return noise | (step.z_m <= 0) | elsewhere


def may_wrap(step: FskStep, sigma_m: np.ndarray) -> np.ndarray:
    """Flag pixels of a later imaging step that may be off by a period: boolean [n]. sigma_m [n]:
    standard deviation of the depths at which the images were formed.

    The step may wrap from these depths, or, where a filter crossed an edge, from the depths that
    the same images give without the last tone; or it has wrapped against one of the first two
    tones only.
    """
    coarse = replace(step, images=step.images[:-1])
    amplitude = np.abs(coarse.images).mean(axis=0)
    coarse_sigma_m = spread_m(quadrature_m(coarse), amplitude, step.pixels)
    flags = np.ptp(step.steps_m(), axis=0) > half_period_m(step)
    for step_m, before_m in (
        (step.correction_m, sigma_m),
        (step.correction_m - coarse.correction_m, coarse_sigma_m),
    ):
        ambiguity_m = half_period_m(step) * step.factor
        flags |= wrap_probability(step_m, before_m, ambiguity_m) > WRAP_PROBABILITY
    return np.asarray(flags)


def velocity_sigma_m_s(step: FskStep, depth: DepthMap) -> np.ndarray:
    """Predict the standard deviation (1σ) of the velocities of a depth map [ny, nx], m/s, from the
    imaging step that they were measured in.

    Noise and speckle are estimated, as for depths, from the amplitude difference of the tone that
    is measured twice. A share of the velocity is added, since a glossy surface shows itself to some
    antennas more than to others, which see another part of the velocity. Share and factor are those
    with which 95 % intervals hold for hands that turn, approach, wave and tremble at 0 to 0.2 m/s.
    """
    assert depth.velocity_limit_m_s is not None
    # as of a depth step, with fT = c / 4v in place of Δf
    fT = SPEED_OF_LIGHT_M_S / (4 * depth.velocity_limit_m_s)
    noise_m_s = quadrature_step_m(step.again[1], step.again[0], fT)
    noise_m_s = step.pixels.on_map(spread_m(step.filtered(noise_m_s), step.amplitude, step.pixels))
    return np.hypot(TAILS * noise_m_s, OTHER_LINE_OF_SIGHT * np.asarray(depth.velocity_m_s))
