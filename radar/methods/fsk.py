"""Frequency-shift keying: depth from the phase between images at a few tones (the paper's iterations).

Under time e^{+jωt} an image formed at z_e of a scatterer at z has φ = arg(O_b · conj(O_a)) = 4π(f_b − f_a)(z_e − z)/c,
so z = z_e − cφ / (4π(f_b − f_a)), unambiguous within ±c/(4(f_b − f_a)). The path's derivative along z, 2 on the
axis, is smaller off it; the paper leaves that out and `off_axis` puts it in.

Two close tones find the depth far and wide, but roughly. Each further tone is a rung of a ladder: it lies further from
the first two, measures more finely, and holds where the rungs before it have found the depth to within its ambiguity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.data.capture import RadarCapture, near_one
from radar.data.depthmap import DepthMap, amplitude_db
from radar.data.grid import PixelGrid, VoxelGrid
from radar.imaging.api import image_points, image_volume
from radar.imaging.cpu.steering import mean_rise
from radar.methods.confidence import incoherent, quadrature_step_m, spread_m, wrap_probability
from radar.methods.fsk_config import FskConfig, LadderConfig, RefinedConfig, ThreeToneConfig, TwoToneConfig, reach_hz
from radar.methods.smoothing import bounding_box, masked_mean

MAX_IMAGES = 6  # passes of the coarse stage; the paper's two suffice for a hand
SHARPER = 1.15  # times as high a plane's peak shows the focus: speckle and gloss make up 1.1, a hand out of it 1.24
NOISY = 0.25  # share of a target without coherence from which on none of it is trusted; noise alone: 0.4 to 0.6

Step = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def depth_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Δz = −cφ / (4πΔf) with φ = arg(O_b conj(O_a)) and difference_hz = Δf = f_b − f_a; metres."""
    phase = np.angle(image_b.astype(np.complex128) * np.conj(image_a))
    return -SPEED_OF_LIGHT_M_S * phase / (4 * np.pi * difference_hz)


def stretch(points_m: np.ndarray, aperture: Aperture, off_axis: bool) -> np.ndarray | float:
    """What Δz is multiplied by at points [n, 3]: 1 in the paper; else 2 over d(|p − t| + |p − r|)/dz, averaged
    over the antennas: 1 on the axis far away, 1.3 at the corner of the paper's image."""
    if not off_axis:
        return 1.0
    points = np.ascontiguousarray(points_m, np.float64)
    derivative = sum(leg.passes * mean_rise(leg.position_m, points) for leg in aperture.legs)
    return 2 / derivative


def two_tone(capture: RadarCapture, config: TwoToneConfig, frame: int = 0) -> DepthMap:
    """The paper's 2-FSK: Δz at the strongest pixel corrects z_e, then Δz is taken at every pixel above the threshold.

    The paper corrects z_e once, which settles a target near the axis; a target far off it takes a pass or two more.
    """
    return _depth_map(_coarse(_ladder(capture, config, frame), config), config)


def three_tone(capture: RadarCapture, config: ThreeToneConfig, frame: int = 0) -> DepthMap:
    """The paper's 3-FSK: the smoothed 2-FSK depth becomes a point cloud, imaged at all three tones; the mean of Δz from
    (f3, f1) and (f3, f2) corrects it; an averaging filter comes last."""
    return n_tone(capture, config, frame)


def n_tone(capture: RadarCapture, config: ThreeToneConfig | LadderConfig, frame: int = 0) -> DepthMap:
    """3-FSK with any number of further tones: each corrects the smoothed depth that the tones before it have found."""
    ladder, whole = _ladder(capture, config, frame), config.grid()
    estimate = _coarse(ladder.first(2), config)
    box = bounding_box(np.isfinite(estimate.z_m))  # a target fills a small part of the image
    estimate, grid = estimate.cropped(box), PixelGrid(whole.x_m[box[1]], whole.y_m[box[0]])
    if config.drop_wrapped:
        estimate = estimate.without(estimate.wrapped)
    for count in range(3, len(config.ladder_hz) + 1):
        estimate = estimate.smoothed(config.coarse_filter_px, config.weighted)
        for _ in range(config.fine_refinements):
            estimate = _refined(ladder.first(count), estimate, grid, config)
    estimate = estimate.smoothed(config.fine_filter_px, config.weighted)
    return _depth_map(estimate.padded(whole.shape, box), config)


@dataclass(frozen=True)
class _Estimate:
    """What is known, all [ny, nx]: depth (or its step) and its quadrature (see `radar.methods.confidence`), NaN off
    target; the images' amplitude; and where a phase may have wrapped."""

    z_m: np.ndarray
    quadrature_m: np.ndarray
    amplitude: np.ndarray
    wrapped: np.ndarray

    def smoothed(self, size_px: int, weighted: bool) -> _Estimate:
        weight = self.amplitude**2 if weighted else None
        z_m, quadrature_m = (masked_mean(values, size_px, weight) for values in (self.z_m, self.quadrature_m))
        return replace(self, z_m=z_m, quadrature_m=quadrature_m)

    def cropped(self, box: tuple[slice, slice]) -> _Estimate:
        return _Estimate(self.z_m[box], self.quadrature_m[box], self.amplitude[box], self.wrapped[box])

    def padded(self, shape: tuple[int, int], box: tuple[slice, slice]) -> _Estimate:
        whole = _Estimate(np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape), np.zeros(shape, bool))
        for name, values in vars(self).items():
            getattr(whole, name)[box] = values
        return whole

    def without(self, dropped: np.ndarray) -> _Estimate:
        z_m, quadrature_m = (np.where(dropped, np.nan, values) for values in (self.z_m, self.quadrature_m))
        return replace(self, z_m=z_m, quadrature_m=quadrature_m)

    def sigma_m(self, config: FskConfig) -> np.ndarray:
        return spread_m(self.quadrature_m, self.amplitude, config.spread_px)


@dataclass(frozen=True)
class _Ladder:
    """samples [f, …] and frequencies_hz [f] of a ladder's tones, before an aperture."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    tolerance: float | None

    def first(self, count: int) -> _Ladder:
        return replace(self, samples=self.samples[:count], frequencies_hz=self.frequencies_hz[:count])

    def images(self, points_m: np.ndarray) -> np.ndarray:
        """Every tone at points [n, 3]: complex64 [f, n]."""
        return image_points(self.samples, self.frequencies_hz, self.aperture, points_m, self.tolerance, apart=True)

    def plane(self, grid: PixelGrid, z_m: float) -> np.ndarray:
        """Every tone at the pixels of a plane, but for a common phase: complex64 [f, ny · nx]."""
        plane = VoxelGrid(grid.x_m, grid.y_m, np.array([z_m]))
        tones = self.samples, self.frequencies_hz, self.aperture
        images = image_volume(*tones, plane, self.tolerance, apart=True, carrier=False)
        return images.reshape(len(images), -1)

    def steps_m(self, images: np.ndarray, step: Step = depth_step_m) -> np.ndarray:
        """The last tone's steps from the first two (of two tones, from the other), for images [f, n]: [1 or 2, n]."""
        last, f = len(images) - 1, self.frequencies_hz
        return np.array([step(images[i], images[last], f[i] - f[last]) for i in range(min(2, last))])

    def steps(self, images: np.ndarray, factor: np.ndarray | float, on_target: np.ndarray) -> _Estimate:
        """What images [f, n] of the n pixels on target say about the error of the depths that they were formed at."""
        return _Estimate(
            z_m=_on_map(on_target, self.steps_m(images).mean(axis=0) * factor),
            quadrature_m=_on_map(on_target, self.steps_m(images, quadrature_step_m).mean(axis=0) * factor),
            amplitude=_on_map(on_target, np.abs(images).mean(axis=0), elsewhere=0.0),
            wrapped=np.zeros(on_target.shape, bool),
        )


def _ladder(capture: RadarCapture, config: TwoToneConfig | RefinedConfig, frame: int) -> _Ladder:
    samples, frequencies_hz = capture.tones(config.ladder_hz, frame)
    return _Ladder(near_one(samples), frequencies_hz, capture.aperture, config.tolerance)


def _coarse(pair: _Ladder, config: FskConfig) -> _Estimate:
    """2-FSK."""
    grid, z_e, correction_m = config.grid(), config.first_depth_m, 0.0
    for passes in range(MAX_IMAGES):
        z_e += correction_m
        images = pair.plane(grid, z_e)
        amplitude = np.abs(images).mean(axis=0)
        strongest = [amplitude.argmax()]
        factor = stretch(grid.points_at_m(strongest, z_e), pair.aperture, config.off_axis)
        [correction_m] = pair.steps_m(images[:, strongest])[0] * factor
        if passes > 0 and abs(correction_m) < config.settled_m:
            break
    seen = amplitude_db(amplitude) >= config.threshold_db
    factor = stretch(grid.points_at_m(np.flatnonzero(seen), z_e), pair.aperture, config.off_axis)
    on_target = seen.reshape(grid.shape)
    step = pair.steps(images[:, seen], factor, on_target)
    z_m, amplitude = z_e + step.z_m, amplitude.reshape(grid.shape)
    period_m = SPEED_OF_LIGHT_M_S / (2 * reach_hz(pair.frequencies_hz))
    ambiguity_m = _on_map(on_target, period_m / 2 * factor)
    noise = incoherent(step.sigma_m(config), ambiguity_m)
    if np.count_nonzero(noise) > NOISY * np.count_nonzero(on_target):  # what is stronger is but the noise's peaks
        noise = on_target
    behind_the_array = z_m <= 0  # a depth of another period
    out_of_focus = _sharper_elsewhere(pair.first(1), grid, z_e, period_m, np.abs(images[0]).max())
    return replace(step, z_m=z_m, amplitude=amplitude, wrapped=noise | behind_the_array | out_of_focus)


def _sharper_elsewhere(tone: _Ladder, grid: PixelGrid, z_m: float, period_m: float, peak: float) -> bool:
    """Whether the plane a period before or behind, where the pair's phase is the same, has a higher peak than z_m's."""
    tone = replace(tone, tolerance=None)  # points that change from frame to frame, too few to be worth a plan
    planes_m = [there_m for there_m in (z_m - period_m, z_m + period_m) if there_m > 0]
    return any(_peak(tone, grid, there_m) > SHARPER * peak for there_m in planes_m)


def _peak(tone: _Ladder, grid: PixelGrid, z_m: float) -> float:
    """The highest amplitude of one tone on a plane: of points a resolution cell λz/2D apart, then about the highest."""
    wide_m = max(np.ptp(leg.position_m, axis=0).max() for leg in tone.aperture.legs)
    cells_per_m = 2 * wide_m * tone.frequencies_hz[0] / (SPEED_OF_LIGHT_M_S * np.hypot(z_m, wide_m))
    counts = [min(len(axis), 2 + int(np.ptp(axis) * cells_per_m)) for axis in (grid.x_m, grid.y_m)]
    x_m, y_m = (np.linspace(axis[0], axis[-1], n) for axis, n in zip((grid.x_m, grid.y_m), counts, strict=True))
    points = PixelGrid(x_m, y_m).points_m(z_m).reshape(-1, 3)
    highest = points[np.abs(tone.images(points)).argmax()]
    about = [np.linspace(-0.5, 0.5, 5) * (axis[1] - axis[0] if len(axis) > 1 else 0.0) for axis in (x_m, y_m)]
    return float(np.abs(tone.images(highest + PixelGrid(*about).points_m(0.0).reshape(-1, 3))).max())


def _refined(ladder: _Ladder, before: _Estimate, grid: PixelGrid, config: RefinedConfig) -> _Estimate:
    """One rung: the ladder's last tone corrects every point of the estimate before it."""
    on_target = np.isfinite(before.z_m)
    if not on_target.any():
        return before
    points = grid.points_at_m(np.flatnonzero(on_target), before.z_m[on_target])
    images, factor = ladder.images(points), stretch(points, ladder.aperture, config.off_axis)
    step = ladder.steps(images, factor, on_target)
    # The rung below, seen from the same points, tells where these are wrong themselves: where a filter crossed an edge.
    below = ladder.first(len(images) - 1).steps(images[:-1], factor, on_target)
    half_period_m = SPEED_OF_LIGHT_M_S / (4 * reach_hz(ladder.frequencies_hz))
    ambiguity_m = _on_map(on_target, half_period_m * factor)
    parted = _on_map(on_target, np.ptp(ladder.steps_m(images), axis=0)) > half_period_m  # one of two has wrapped
    probability = np.maximum(
        wrap_probability(step.z_m, before.sigma_m(config), ambiguity_m),
        wrap_probability(step.z_m - below.z_m, below.sigma_m(config), ambiguity_m),
    )
    wrapped = before.wrapped | parted | (probability > config.wrap_probability)
    refined = replace(step, z_m=before.z_m + step.z_m, wrapped=wrapped)
    return refined.without(wrapped) if config.drop_wrapped else refined


def _on_map(on_target: np.ndarray, values: np.ndarray | float, elsewhere: float = np.nan) -> np.ndarray:
    """Values [n] of the pixels on target as a map [ny, nx]."""
    whole = np.full(on_target.shape, elsewhere)
    whole[on_target] = values
    return whole


def _depth_map(estimate: _Estimate, config: TwoToneConfig | RefinedConfig) -> DepthMap:
    """The estimate with its axes, named after the number of its tones."""
    return DepthMap(
        x_m=config.x.values_m(),
        y_m=config.y.values_m(),
        z_m=estimate.z_m,
        amplitude_db=amplitude_db(estimate.amplitude),
        method=f"{len(config.ladder_hz)}fsk",
        config=config.model_dump(),
        sigma_m=estimate.sigma_m(config),
        wrapped=estimate.wrapped,
    )
