"""Frequency-shift keying: depth from the phase between images at a few tones, in the paper's five steps.

Under time e^{+jωt} an image formed at z_e of a scatterer at z has φ = arg(O_b · conj(O_a)) = 4π(f_b − f_a)(z_e − z)/c,
so z = z_e − cφ / (4π(f_b − f_a)), unambiguous within ±c/(4(f_b − f_a)). The path's derivative along z, 2 on the
axis, is smaller off it; the paper leaves that out and `off_axis` puts it in.

Two close tones find the depth far and wide, but roughly. Each further tone is a rung of a ladder: it lies further from
the first two, measures more finely, and holds where the rungs before it have found the depth to within its ambiguity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from handbench.radar.data.capture import RadarCapture, near_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import PixelGrid, VoxelGrid, bounding_box
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.imaging.cpu.steering import mean_rise
from handbench.radar.methods.confidence import Review
from handbench.radar.methods.fsk_config import AnyConfig, FskConfig, RefinedConfig, reach_hz
from handbench.radar.methods.fsk_config import TwoToneConfig as TwoToneConfig  # which plug-ins import from here
from handbench.radar.methods.smoothing import masked_mean

Step = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def fsk(
    capture: RadarCapture, config: AnyConfig, frame: int = 0, review: Callable[[Look], np.ndarray] | None = None
) -> DepthMap:
    """The paper's 2-FSK and 3-FSK, and the same with further tones. `review` hears of every look at the target and
    says with which depths [ny, nx] to go on; None: with those that the look tells."""
    tones, grid, review = Tones.of(capture, config, frame), config.grid(), review or (lambda look: look.z_m)
    look = first_look(tones, config)
    if isinstance(config, RefinedConfig):
        z_m = review(look := look.cropped())
        for count in range(3, len(tones) + 1):
            z_m = look.smoothed(z_m, config.coarse_filter_px)
            for _ in range(config.fine_refinements):
                if not np.isfinite(z_m).any():  # `review` has dropped them all
                    break
                # Step 4: the curved surface found so far is imaged at f3, too.
                look = tones.first(count).surface(look.grid, z_m)
                # Step 5: the phases between f3 and the others correct every point; an averaging filter comes last.
                z_m = review(look)
        z_m = look.smoothed(z_m, config.fine_filter_px)
    else:
        z_m = review(look)
    z_m, amplitude = grid.placed(look.grid, z_m), grid.placed(look.grid, look.amplitude, 0.0)
    return DepthMap(grid.x_m, grid.y_m, z_m, amplitude_db(amplitude), f"{len(tones)}fsk", config.model_dump())


def first_look(tones: Tones, config: FskConfig) -> Look:
    """Steps 1 to 3: the look at the pixels on target in the plane that the first two tones find."""
    # Step 1: the plane z_e is imaged at f1 and f2.
    grid, z_e = config.grid(), config.first_depth_m
    plane = tones.first(2).plane(grid, z_e)
    for done in range(config.corrections):
        # Step 2: the phase at the strongest pixel corrects z_e, in the paper once, and the plane there is imaged.
        [correction_m] = plane.only(np.array([plane.amplitude.argmax()])).correction_m
        if done > 0 and abs(correction_m) < config.settled_m:
            break
        z_e += correction_m
        plane = tones.first(2).plane(grid, z_e)
    # Step 3: every pixel above the threshold takes the depth that its phase tells.
    return plane.only(np.flatnonzero(amplitude_db(plane.amplitude) >= config.threshold_db))


def n_tone(capture: RadarCapture, config: AnyConfig, frame: int = 0) -> DepthMap:
    """The depth map of `fsk` with its predicted error and its flags."""
    review = Review(config)
    return review.added_to(fsk(capture, config, frame, review))


two_tone = three_tone = n_tone  # the paper's, by their configurations


def depth_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Δz = −cφ / (4πΔf) with φ = arg(O_b conj(O_a)) and difference_hz = Δf = f_b − f_a; metres."""
    phase = np.angle(image_b.astype(np.complex128) * np.conj(image_a))
    return -SPEED_OF_LIGHT_M_S * phase / (4 * np.pi * difference_hz)


def path_rise(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """d(|p − t| + |p − r|)/dz [n] at points [n, 3], averaged over the channels."""
    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))


def stretch(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """The factor of Δz at points [n, 3] that the paper takes as 1: 2 over `path_rise`. It is 1 on the axis far
    away, and 1.3 at the corner of the paper's image."""
    return np.asarray(2 / path_rise(points_m, aperture))


@dataclass(frozen=True)
class Tones:
    """samples [f, …] at frequencies_hz [f] before an aperture, and how they are to be imaged."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    config: AnyConfig

    @classmethod
    def of(cls, capture: RadarCapture, config: AnyConfig, frame: int) -> Tones:
        """The tones that are configured."""
        samples, frequencies_hz = capture.tones(config.ladder_hz, frame)
        return cls(near_one(samples), frequencies_hz, capture.aperture, config)

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def period_m(self) -> float:
        """Depths that far apart have the same phase between the last tone and one of the first two, on the axis."""
        return SPEED_OF_LIGHT_M_S / (2 * reach_hz(self.frequencies_hz))

    def first(self, count: int) -> Tones:
        """The first `count` of them."""
        return replace(self, samples=self.samples[:count], frequencies_hz=self.frequencies_hz[:count])

    def images(self, points_m: np.ndarray, tolerance: float | None) -> np.ndarray:
        """Every tone at points [n, 3]: complex64 [f, n]."""
        return image_points(self.samples, self.frequencies_hz, self.aperture, points_m, tolerance, apart=True)

    def plane(self, grid: PixelGrid, z_m: float) -> Look:
        """The look at all pixels of a plane, but for a phase that the tones share."""
        plane, tolerance = VoxelGrid(grid.x_m, grid.y_m, np.array([z_m])), self.config.tolerance
        images = image_volume(
            self.samples, self.frequencies_hz, self.aperture, plane, tolerance, apart=True, carrier=False
        )
        images = images.reshape(len(images), -1)
        magnitude, index = np.abs(images), np.arange(images.shape[1])
        return Look(self, grid, index, z_m, images, magnitude.mean(axis=0).reshape(grid.shape), magnitude[0].max())

    def surface(self, grid: PixelGrid, z_m: np.ndarray) -> Look:
        """The look at a grid's pixels whose depth z_m [ny, nx] is known, from there."""
        index = np.flatnonzero(np.isfinite(z_m))
        formed_m = z_m.ravel()[index]
        return _look(self, grid, index, formed_m, self.images(grid.points_at_m(index, formed_m), self.config.tolerance))


@dataclass(frozen=True)
class Look:
    """Images [f, n] of `tones` at those pixels of a grid whose flat indices are index [n], formed at the depths
    formed_m, one or [n]; amplitude: the images' mean [ny, nx]; peak: the highest of the first tone's whole image."""

    tones: Tones
    grid: PixelGrid
    index: np.ndarray
    formed_m: float | np.ndarray
    images: np.ndarray
    amplitude: np.ndarray
    peak: float = np.nan

    @cached_property
    def factor(self) -> np.ndarray | float:
        """`stretch` at the pixels, where it is configured; else the paper's 1."""
        if not self.tones.config.off_axis:
            return 1.0
        return stretch(self.grid.points_at_m(self.index, self.formed_m), self.tones.aperture)

    @cached_property
    def correction_m(self) -> np.ndarray:
        """The error [n], as the phases tell it, of the depths that the images were formed at."""
        return self.steps_m().mean(axis=0) * self.factor

    @cached_property
    def z_m(self) -> np.ndarray:
        """The corrected depths [ny, nx], NaN off target."""
        return self.on_map(self.formed_m + self.correction_m)

    def steps_m(self, step: Step = depth_step_m) -> np.ndarray:
        """The last tone's steps from the first two (of two tones, from the other): [1 or 2, n]."""
        images, f = self.images, self.tones.frequencies_hz
        last = len(images) - 1
        return np.array([step(images[i], images[last], f[i] - f[last]) for i in range(min(2, last))])

    def only(self, index: np.ndarray) -> Look:
        """A plane's look at some of its pixels."""
        return replace(self, index=index, images=self.images[:, index])

    def cropped(self) -> Look:
        """The look on the smallest part of its grid: a target fills little of an image."""
        on_target = self.on_map(np.array(True), False)
        box = bounding_box(on_target)
        index, amplitude = np.flatnonzero(on_target[box]), self.amplitude[box]
        return replace(self, grid=self.grid.part(box), index=index, amplitude=amplitude)

    def below(self) -> Look:
        """The same look without its last tone."""
        return _look(self.tones.first(len(self.tones) - 1), self.grid, self.index, self.formed_m, self.images[:-1])

    def smoothed(self, values: np.ndarray, size_px: int) -> np.ndarray:
        """The averaging filter for a map [ny, nx], weighted with power if so configured."""
        weighted = isinstance(self.tones.config, RefinedConfig) and self.tones.config.weighted
        return masked_mean(values, size_px, self.amplitude**2 if weighted else None)

    def at(self, values: np.ndarray) -> np.ndarray:
        """The values of a map [ny, nx] at the pixels: [n]."""
        return values.ravel()[self.index]

    def on_map(self, values: np.ndarray, elsewhere: float = np.nan) -> np.ndarray:
        """The pixels' values [n] as a map [ny, nx]."""
        return self.grid.on_map(self.index, values, elsewhere)


def _look(tones: Tones, grid: PixelGrid, index: np.ndarray, formed_m: float | np.ndarray, images: np.ndarray) -> Look:
    amplitude = grid.on_map(index, np.abs(images).mean(axis=0), elsewhere=0.0)
    return Look(tones, grid, index, formed_m, images, amplitude)
