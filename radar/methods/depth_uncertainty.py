"""Standard deviations σ and wrap flags of FSK's depths, from the images that gave the depths.

White noise and speckle have no preferred phase: one quadrature of their contribution to
O_b·conj(O_a) turns its phase, which moves the depth; the other, equally strong, changes its
amplitude, which should be the same at neighbouring tones. So amplitude differences measure the
phase errors. With ρ = (|O_b| − |O_a|) / ½(|O_b| + |O_a|) as large as the error of φ,

    σ_z = c / (4πΔf) · σ_φ
    σ_φ = rms(ρ·A) / A   (σ_φ ∝ 1/A: noise is as strong where the echo is weak),

where the mean square of ρ·A is the average of two: over a window of a few resolution cells (speckle
is local) and over the whole target (a window has few independent values). No noise level is assumed
or fitted.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.fsk import Fsk, FskEchoes, FskStep, fsk, reach_hz
from handbench.radar.methods.pixels import masked_mean

# below so many pixels, a few resolution cells, no median is subtracted: it would hide the noise
FEW = 100
SPREAD_PX = 9  # window over which the mean square of errors is averaged: two resolution cells
WRAP_PROBABILITY = 0.1  # that a pixel is a period off, above which it is flagged
# least window of the local mean from which a pixel's own error is measured
LOCAL_PX = 5
# a filter that moves a pixel by more has mixed two surfaces
OTHER_SURFACE_M = 0.003
# least σ, whose square is still a number
TINY_M = 1e-150
# a plane whose peak is higher by this factor is in focus: speckle and gloss reach 1.1, a hand 1.24
SHARPER = 1.15
# A plane whose image is wider by this factor is out of focus in spite of its peak (four fingers: 5;
# a far target: 0.2 to 1.4).
WIDER = 2.0
# share of incoherent pixels above which the whole target is flagged (noise only: 0.4 to 0.6)
NOISY = 0.25
# rms of ρ between unrelated images (Rayleigh amplitudes): its largest value
UNRELATED_RAD = 2 * np.sqrt(np.pi - 3)
TAILS = 1.15  # the noise of velocities has wider tails than a Gaussian of its estimated σ
OTHER_LINE_OF_SIGHT = 0.014  # share of the velocity


def quadrature_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Compute the quadrature step cρ / (4πΔf) of two images, metres, which measures the error of
    their depth step.

    It has the relative difference ρ of the amplitudes in place of the phase φ of the depth step;
    noise and speckle disturb both equally. difference_hz: Δf = f_b − f_a.
    """
    b, a = np.abs(image_b).astype(np.float64), np.abs(image_a).astype(np.float64)
    with np.errstate(invalid="ignore"):  # an image of zeros has no confidence
        ratio = 2 * (b - a) / (b + a)
    return SPEED_OF_LIGHT_M_S * ratio / (4 * np.pi * difference_hz)


def spread_m(
    quadrature_m: np.ndarray, amplitude: np.ndarray, window_px: int = SPREAD_PX
) -> np.ndarray:
    """Predict the standard deviation (1σ) of depths [ny, nx], metres, from their quadrature steps:
    these are depth errors that the amplitude difference of two tones shows.

    quadrature_m, amplitude: [ny, nx], NaN off target; window_px: window over which the mean square
    is averaged, besides the whole map. If there are enough pixels, the median of the quadrature
    steps is subtracted first, since the tones may differ in gain.
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


def speckle_spread_m(points_m: np.ndarray, amplitude: np.ndarray, filter_px: int) -> np.ndarray:
    """Predict the standard deviation (1σ) of the depth that is due to speckle: [ny, nx], metres.
    Speckle can turn all tones of a pixel by the same phase, so that the tones do not show it.

    It is estimated from how far the surface's points [ny, nx, 3] deviate in distance from their
    mean over filter_px pixels (LOCAL_PX at least).
    """
    distance_m = np.linalg.norm(points_m, axis=-1)  # one in all of a scatterer's lobe
    local_m = distance_m - masked_mean(distance_m, max(filter_px, LOCAL_PX), amplitude**2)
    return spread_m(np.clip(local_m, -OTHER_SURFACE_M, OTHER_SURFACE_M), amplitude)


def incoherent(sigma_m: np.ndarray, ambiguity_m: np.ndarray | float) -> np.ndarray:
    """Return True for pixels whose phase is only noise: three of its standard deviations exceed
    half a turn. sigma_m: predicted depth error; ±ambiguity_m: unambiguous range, which is half a
    turn.

    The amplitudes show the standard deviation σ_φ = πσ_z/a, a = ambiguity_m, only up to σ₀, the
    value for unrelated images; s = σ_φ/√(1 − (σ_φ/σ₀)²) corrects this, and 3s > π where σ_φ exceeds
    (π/3)σ₀/√((π/3)² + σ₀²) = 0.61.
    """
    most_rad = np.pi / 3 * UNRELATED_RAD / np.hypot(np.pi / 3, UNRELATED_RAD)
    return sigma_m > most_rad / np.pi * ambiguity_m


def wrap_probability(
    step_m: np.ndarray, sigma_m: np.ndarray, ambiguity_m: np.ndarray | float
) -> np.ndarray:
    """Compute the probability that a depth correction step_m is wrong by one period 2a, because it
    comes from a phase that is unambiguous only within ±a = ambiguity_m.

    sigma_m: standard deviation σ of the depth before the correction Δz. With an error of N(0, σ)
    there, the odds of |Δz| against 2a − |Δz| are exp(−2a(a − |Δz|)/σ²).
    """
    variance_m2 = np.maximum(sigma_m, TINY_M) ** 2
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(2 * ambiguity_m * (ambiguity_m - np.abs(step_m)) / variance_m2))


def fsk_with_uncertainty(capture: RadarCapture, config: Fsk, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame by an FSK method, with predicted 1σ and flags for pixels
    that may be wrong. With config.drop_doubtful, flagged pixels become NaN after each imaging
    step."""
    uncertainty = Uncertainty(config)
    if config.drop_doubtful:
        depth, _ = fsk(capture, config, frame, on_step=uncertainty.add)
    else:
        depth, steps = fsk(capture, config, frame)
        for step in steps:
            uncertainty.add(step)
    return uncertainty.added_to(depth)


class Uncertainty:
    """Predicted errors and flags of a depth map, built up from the imaging steps of an FSK method:
    call `add` for each step in order, then `added_to`.

    quadrature_m [ny, nx]: depth error, metres, that the amplitudes show in the last step
    (`quadrature_step_m`), filtered like the depths; wrapped [ny, nx]: True at flagged pixels, whose
    phase may have wrapped or is noise. Both are on the grid of the steps.
    """

    def __init__(self, config: Fsk) -> None:
        self.config = config
        self.last: FskStep | None = None
        self.quadrature_m = self.wrapped = np.zeros((0, 0))

    def add(self, step: FskStep) -> np.ndarray:
        """Update errors and flags with the next imaging step, and return its depths [ny, nx],
        metres: NaN off target and, with config.drop_doubtful, at flagged pixels."""
        if self.last is not None:
            self.wrapped = self._surface(step, self.last)
        self.quadrature_m = quadrature_m(step)
        if self.last is None:
            self.wrapped = self._plane(step)
        self.last = step
        if not self.config.drop_doubtful:
            return step.z_m
        self.quadrature_m[self.wrapped] = np.nan
        return np.where(self.wrapped, np.nan, step.z_m)

    def added_to(self, depth: DepthMap) -> DepthMap:
        """Return the final depth map with sigma_m, the predicted 1σ, and `wrapped`, the flags."""
        step = self.last
        assert step is not None
        if len(self.config.tones_hz) == 2:
            sigma_m = self._sigma_m(step, self.quadrature_m)
        else:  # two estimates of the same error: the larger one counts
            sigma_m = self._sigma_m(step, step.filtered(self.quadrature_m))
            points_m = step.grid.points_m(np.where(np.isfinite(sigma_m), step.z_m, np.nan))
            speckle_m = speckle_spread_m(points_m, step.amplitude, self.config.filter_px)
            sigma_m = np.fmax(sigma_m, speckle_m)
        if len(step.again):
            depth = replace(depth, velocity_sigma_m_s=velocity_sigma_m_s(step, depth))
        return replace(depth, sigma_m=sigma_m, wrapped=self.wrapped)

    def _plane(self, step: FskStep) -> np.ndarray:
        """Flag pixels of the first imaging step, which images one plane: boolean [ny, nx].

        Flagged are noise, depths behind the array, and all pixels if the plane one period before or
        behind has the sharper image.
        """
        sigma_m = self._sigma_m(step, self.quadrature_m).ravel()[step.index]
        noise = incoherent(sigma_m, half_period_m(step) * step.factor)
        if np.count_nonzero(noise) > NOISY * len(noise):  # the rest are peaks of the noise
            noise[:] = True
        behind_the_array = step.z_m <= 0
        noise = step.grid.on_map(step.index, noise, 0) > 0
        return noise | behind_the_array | _sharper_elsewhere(step)

    def _surface(self, step: FskStep, before: FskStep) -> np.ndarray:
        """Flag pixels of a later imaging step, `before` being the one before it: boolean [ny, nx].

        Flagged are pixels that were flagged before, those where the depths from the last tone with
        the first and with the second tone disagree, and those whose depth may be off by a period.
        """
        if len(step.images) > len(before.images):
            self.quadrature_m = before.filtered(self.quadrature_m)
        # The rung below, imaged at the same points, shows wrong starting depths: a filter crossed
        # an edge.
        amplitude = step.grid.on_map(step.index, np.abs(step.images[:-1]).mean(axis=0), 0.0)
        below = replace(step, images=step.images[:-1], amplitude=amplitude)
        steps_m = step.correction_m, step.correction_m - below.correction_m
        sigmas_m = (
            self._sigma_m(before, self.quadrature_m),
            self._sigma_m(below, quadrature_m(below)),
        )
        ambiguity_m = half_period_m(step) * step.factor
        probability = np.maximum(
            *(
                wrap_probability(step_m, sigma_m.ravel()[step.index], ambiguity_m)
                for step_m, sigma_m in zip(steps_m, sigmas_m, strict=True)
            )
        )
        parted = np.ptp(step.steps_m(), axis=0) > half_period_m(step)  # one of two has wrapped
        flags = parted | (probability > WRAP_PROBABILITY)
        return self.wrapped | (step.grid.on_map(step.index, flags, 0) > 0)

    def _sigma_m(self, step: FskStep, quadrature_m: np.ndarray) -> np.ndarray:
        return spread_m(quadrature_m, step.amplitude)


def half_period_m(step: FskStep) -> float:
    """Return the unambiguous range ±c / 4Δf, metres on the axis, of the last tone's depths."""
    return float(SPEED_OF_LIGHT_M_S / (4 * reach_hz(step.frequencies_hz)))


def quadrature_m(step: FskStep) -> np.ndarray:
    """Compute the depth error, metres, that the amplitude differences between the tones of an
    imaging step show at each pixel (`quadrature_step_m`): [ny, nx], averaged over tones and scaled
    like the step's depth correction."""
    errors_m = step.steps_m(quadrature_step_m).mean(axis=0) * step.factor
    return step.grid.on_map(step.index, errors_m)


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
    noise_m_s = step.grid.on_map(step.index, quadrature_step_m(step.again[1], step.again[0], fT))
    noise_m_s = spread_m(step.filtered(noise_m_s), step.amplitude)
    return np.hypot(TAILS * noise_m_s, OTHER_LINE_OF_SIGHT * np.asarray(depth.velocity_m_s))


def _sharper_elsewhere(step: FskStep) -> bool:
    """Return True if the target seems to be one period before or behind the plane that an imaging
    step has imaged, where the pair of tones has the same phases.

    That is so if the image of the plane there has a higher peak and is not more spread out. The
    second condition is needed because the wider resolution cells of a farther plane collect the
    echoes of several places.
    """
    z_m, period_m = float(step.formed_m[0]), 2 * half_period_m(step)
    planes = [
        _focus(step.echoes, there_m) for there_m in (z_m - period_m, z_m + period_m) if there_m > 0
    ]
    own_peak = np.abs(step.images[0]).max()
    higher = [spread_m2 for peak, spread_m2 in planes if peak > SHARPER * own_peak]
    return bool(higher) and min(higher) < WIDER * _focus(step.echoes, z_m)[1]


def _focus(echoes: FskEchoes, z_m: float) -> tuple[float, float]:
    """Image a plane coarsely at the first tone and measure its focus: (highest amplitude, area in
    m² over which the image is spread). The area is (∫P)² / ∫P² of the power P.

    The points are a resolution cell λz/2D apart, and closer around the strongest. They are summed
    exactly, since so few points are not worth a plan.
    """
    from handbench.radar.imaging.api import image_points  # numba, which settings do not need

    grid, aperture, hz = echoes.config.pixels, echoes.aperture, echoes.frequencies_hz[:1]
    wide_m = max(np.ptp(leg.position_m, axis=0).max() for leg in aperture.legs)
    cells_per_m = 2 * wide_m * hz[0] / (SPEED_OF_LIGHT_M_S * np.hypot(z_m, wide_m))
    counts = [min(len(axis), 2 + int(np.ptp(axis) * cells_per_m)) for axis in (grid.x_m, grid.y_m)]
    x_m, y_m = (
        np.linspace(axis[0], axis[-1], n)
        for axis, n in zip((grid.x_m, grid.y_m), counts, strict=True)
    )
    points = PixelGrid(x_m, y_m).points_m(z_m).reshape(-1, 3)
    image = partial(image_points, echoes.samples[:1], hz, aperture, tolerance=None)
    power = np.abs(image(points)).astype(np.float64) ** 2
    area_m2 = float(np.ptp(x_m) * np.ptp(y_m)) / len(power)
    spread_m2 = power.sum() ** 2 / max((power**2).sum(), TINY_M) * area_m2
    about = [
        np.linspace(-0.5, 0.5, 5) * (axis[1] - axis[0] if len(axis) > 1 else 0.0)
        for axis in (x_m, y_m)
    ]
    near = points[power.argmax()] + PixelGrid(*about).points_m(0.0).reshape(-1, 3)
    return float(np.abs(image(near)).max()), float(spread_m2)
