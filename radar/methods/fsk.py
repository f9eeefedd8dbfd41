"""Frequency-shift keying (FSK): depth from the phase between images at a few tones, in the paper's
five steps.

Under time e^{+jωt} the images of a scatterer at z, formed at depth z_e, have the phase difference φ
= arg(O_b · conj(O_a)) = 4π(f_b − f_a)(z_e − z)/c, so z = z_e − cφ / (4π(f_b − f_a)), unambiguous
within ±c/(4(f_b − f_a)). Here the path grows by 2 m per metre of depth, which holds on the axis and
is less off it; the paper ignores the difference and the setting `off_axis` corrects it.

Two close tones determine the depth in a wide range, but roughly. Each further tone is a rung of a
ladder: it is further from the first two and more precise, and valid if the rungs before it have
found the depth to within its ambiguity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from handbench.radar.data.capture import RadarCapture, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import PixelGrid, VoxelGrid, bounding_box
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.imaging.cpu.steering import mean_rise
from handbench.radar.methods.doppler import Repetition
from handbench.radar.methods.first_depth import with_first_depth
from handbench.radar.methods.fsk_config import AnyConfig, RefinedConfig, reach_hz
from handbench.support.compiled import FAST, njit
from handbench.support.errors import HandbenchError


def fsk(
    capture: RadarCapture,
    config: AnyConfig,
    frame: int = 0,
    on_step: Callable[[FskStep], np.ndarray] | None = None,
) -> tuple[DepthMap, list[FskStep]]:
    """Compute the depth map of a frame by 2-FSK, 3-FSK or a longer ladder of tones (Bräunig et al.,
    section II): (map, imaging steps that led to it). The map has no σ or flags;
    `radar.methods.depth_uncertainty` computes them from the steps.

    on_step: called after each imaging step; returns the depths [ny, nx] in metres from which the
    next step starts (default: the step's own).
    """
    config = with_first_depth(capture, config, frame)
    tones, grid = Tones.of(capture, config, frame), config.grid()
    # 1 to 3: the plane at f1 and f2, z_e corrected once, depths above the threshold.
    step = first_step(tones)
    if isinstance(config, RefinedConfig):
        step = step.cropped()
    steps = [step]
    on_step = on_step or (lambda step: step.z_m)
    z_m = on_step(step)
    if isinstance(config, RefinedConfig):
        for count in range(3, len(tones) + 1):
            z_m = step.filtered(z_m, config.coarse_filter_px)
            for _ in range(config.fine_refinements):
                if not np.isfinite(z_m).any():  # on_step has dropped every pixel
                    break
                # 4: the curved surface found so far is imaged at all tones up to this one.
                step = tones.first(count).surface(step.grid, z_m)
                # 5: the mean of the two corrections between the new tone and the first two.
                z_m = on_step(step)
                steps.append(step)
        z_m = step.filtered(z_m, config.fine_filter_px)
    z_m = grid.placed(step.grid, z_m)
    db = grid.placed(step.grid, amplitude_db(step.amplitude), -np.inf).astype(np.float32)
    name = f"{len(tones)}fsk"
    depth = DepthMap(grid.x_m, grid.y_m, z_m, db, name, config.model_dump())
    if (repetition := tones.repetition) is not None:
        velocity_m_s = grid.placed(step.grid, step.velocity_m_s)
        depth = replace(depth, velocity_m_s=velocity_m_s, velocity_limit_m_s=repetition.limit_m_s)
    return depth, steps


def first_step(tones: Tones) -> FskStep:
    """Do steps 1 to 3 of the paper's method: image a plane at the first two tones, move it to the
    target by their phase, and return the imaging step of the pixels that are at or above the
    threshold."""
    # 1: the plane z_e is imaged at f1 and f2.
    config, pair = tones.config, tones.first(2)
    grid, z_e = config.grid(), float(config.first_depth_m)
    plane = pair.plane(grid, z_e)
    for done in range(config.corrections):
        # 2: the phase at the strongest pixel corrects z_e, in the paper once.
        [correction_m] = plane.where(np.array([plane.amplitude.argmax()])).correction_m
        if done > 0 and abs(correction_m) < config.settled_m:
            break
        z_e += correction_m
        plane = pair.plane(grid, z_e)
    # 3: every pixel above the threshold takes the depth of its own phase.
    return plane.where(np.flatnonzero(amplitude_db(plane.amplitude) >= config.threshold_db))


def depth_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Compute the depth step Δz = −cφ / (4πΔf), metres, from the depth at which two images are
    formed to the depth of the scatterer, by their phase difference φ = arg(O_b conj(O_a)).
    difference_hz: Δf = f_b − f_a."""
    phase = np.angle(image_b.astype(np.complex128) * np.conj(image_a))
    return -SPEED_OF_LIGHT_M_S * phase / (4 * np.pi * difference_hz)


def path_rise(points_m: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Compute by how much the path from transmitter to point to receiver grows per metre along z,
    d(|p − t| + |p − r|)/dz, at points p [n, 3], averaged over the channels: [n], at most 2, its
    value on the axis far away."""
    points = np.ascontiguousarray(points_m, np.float64)
    rises = (leg.passes * mean_rise(leg.position_m, leg.channels, points) for leg in aperture.legs)
    return np.asarray(sum(rises))


@dataclass(frozen=True)
class Tones:
    """The samples [f, …] of one frame at a method's tones frequencies_hz [f], in the order in which
    the method uses them, with the aperture and the method's configuration.

    repetition: the tone that is measured twice, if the method is configured to use it (else None);
    again [2, …]: its samples.
    """

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    config: AnyConfig
    repetition: Repetition | None = None
    again: np.ndarray | None = None

    @classmethod
    def of(cls, capture: RadarCapture, config: AnyConfig, frame: int) -> Tones:
        """Return the samples of one frame of a capture at the configured tones, scaled to about 1.
        Raises HandbenchError if a tone was not measured, or, for velocities, none twice."""
        samples, frequencies_hz = capture.tones(config.ladder_hz, frame)
        if not config.doppler:
            return cls(scaled_to_one(samples), frequencies_hz, capture.aperture, config)
        repetition = Repetition.of(capture, np.asarray(config.ladder_hz))
        again = capture.samples[frame][repetition.measured]
        if samples.any() and not all(one.any() for one in again):
            raise HandbenchError(
                f"echoes: in frame {frame}, a measurement of the tone at "
                f"{repetition.frequency_hz / 1e9:.4g} GHz, which gives the velocity, is 0 in every "
                "channel; record the frame again, or leave it out"
            )
        every = scaled_to_one(np.concatenate([samples, again]))
        return cls(
            every[:-2], frequencies_hz, capture.aperture, config, repetition, again=every[-2:]
        )

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def period_m(self) -> float:
        """Ambiguity of the last tone's depths: the smallest distance, in metres on the axis,
        between depths with the same phase difference between it and one of the first two tones."""
        return SPEED_OF_LIGHT_M_S / (2 * reach_hz(self.frequencies_hz))

    def first(self, count: int) -> Tones:
        """Return the first `count` tones with their samples."""
        return replace(
            self, samples=self.samples[:count], frequencies_hz=self.frequencies_hz[:count]
        )

    def images(self, points_m: np.ndarray, tolerance: float | None) -> np.ndarray:
        """Image points_m [n, 3], in metres, at every tone: complex64 [f, n]. tolerance: largest
        relative L2 error; None: exact."""
        return image_points(
            self.samples, self.frequencies_hz, self.aperture, points_m, tolerance, apart=True
        )

    def plane(self, grid: PixelGrid, z_m: float) -> FskStep:
        """Image all pixels of the plane at depth z_m at every tone, except for a phase factor that
        all tones share: the images and the depths that follow from them, as an `FskStep`."""
        plane, tolerance = VoxelGrid(grid.x_m, grid.y_m, np.array([z_m])), self.config.tolerance

        def image(samples: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
            images = image_volume(
                samples, frequencies_hz, self.aperture, plane, tolerance, apart=True, carrier=False
            )
            return images.reshape(len(images), -1)

        images, again = self._with_repetition(image)
        magnitude, index = np.abs(images), np.arange(images.shape[1])
        return FskStep(
            self,
            grid,
            index,
            z_m,
            images,
            magnitude.mean(axis=0).reshape(grid.shape),
            magnitude[0].max(),
            again,
        )

    def surface(self, grid: PixelGrid, z_m: np.ndarray) -> FskStep:
        """Image the pixels with a finite depth, each at its depth z_m [ny, nx], at every tone: the
        images and the depths that follow from them, as an `FskStep`."""
        index = np.flatnonzero(np.isfinite(z_m))
        formed_m = z_m.ravel()[index]
        points_m, tolerance = grid.points_at_m(index, formed_m), self.config.tolerance

        def image(samples: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
            return image_points(
                samples, frequencies_hz, self.aperture, points_m, tolerance, apart=True
            )

        return _step(self, grid, index, formed_m, *self._with_repetition(image))

    def _with_repetition(
        self, image: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Image every tone: (images [f, n], images [2, n] of the tone that is measured twice, or
        None without one). image: function (samples [k, …], frequencies [k]) → images [k, n]."""
        if self.repetition is None or self.again is None:
            return image(self.samples, self.frequencies_hz), None
        # the first measurement is one of the tones already, if the step uses that tone
        new = self.again[1:] if self.repetition.tone < len(self) else self.again
        hz = np.append(self.frequencies_hz, [self.repetition.frequency_hz] * len(new))
        images = image(np.concatenate([self.samples, new]), hz)
        ours, again = images[: len(self)], images[len(self) :]
        if len(again) == 1:
            again = np.stack([ours[self.repetition.tone], again[0]])
        return ours, again


@dataclass(frozen=True)
class FskStep:
    """One imaging step of an FSK method: complex images [f, n] of `tones` at n pixels of a grid,
    and the depths that follow from their phases.

    index [n]: flat indices of the pixels; formed_m: depths at which the images are formed, one or
    [n]; z_m: depths after the step; amplitude: mean magnitude of the images [ny, nx]; peak: the
    highest magnitude of the first tone's image, if the step images a whole plane (else NaN).
    again [2, n]: images of the tone that is measured twice, if the method uses one (else None).
    """

    tones: Tones
    grid: PixelGrid
    index: np.ndarray
    formed_m: float | np.ndarray
    images: np.ndarray
    amplitude: np.ndarray
    peak: float = np.nan
    again: np.ndarray | None = None

    @cached_property
    def still(self) -> np.ndarray:
        """The images [f, n] without the phase of the target's motion, if a tone is measured
        twice."""
        if self.again is None or self.tones.repetition is None:
            return self.images
        return self.tones.repetition.at_rest(self.images, self.again)

    @cached_property
    def factor(self) -> np.ndarray | float:
        """Factor [n] of the pixels' depth steps, which corrects that the path off the axis grows by
        less than 2 per metre of depth: 2 over `path_rise` if `off_axis` is configured (1.3 at the
        corner of the paper's image), else 1 as in the paper."""
        if not self.tones.config.off_axis:
            return 1.0
        return 2 / path_rise(self.grid.points_at_m(self.index, self.formed_m), self.tones.aperture)

    @cached_property
    def correction_m(self) -> np.ndarray:
        """Depth corrections [n], metres, that the phases give: from the depths at which the images
        were formed to those of the scatterers."""
        return self.steps_m().mean(axis=0) * self.factor

    @cached_property
    def z_m(self) -> np.ndarray:
        """Depths after the step [ny, nx], metres, NaN off target."""
        return self.on_map(self.formed_m + self.correction_m)

    @property
    def velocity_m_s(self) -> np.ndarray:
        """Radial velocities [ny, nx], m/s, NaN off target, of a step whose tones have a repetition,
        from the mean O(T) conj(O(0)) of the repeated tone over the filter of the result. The path
        grows by less than 2 per metre along the line from the array's middle, which is corrected
        (by 3 % for the paper's array at 0.31 m)."""
        repetition, again = self.tones.repetition, self.again
        assert repetition is not None and again is not None
        turned = again[1].astype(np.complex128) * np.conj(again[0])
        size_px = getattr(self.tones.config, "fine_filter_px", 1)
        # of the numbers, not of the angles, which jump where they wrap
        real, imaginary = (
            masked_mean(self.on_map(part), size_px) for part in (turned.real, turned.imag)
        )
        points_m = self.grid.points_at_m(self.index, self.formed_m)
        cosine = points_m[:, 2] / np.linalg.norm(points_m, axis=1)
        along = path_rise(points_m, self.tones.aperture) / cosine
        return repetition.velocity_m_s(real + 1j * imaginary) * self.on_map(2 / along)

    def steps_m(self) -> np.ndarray:
        """Compute the depth steps, metres, of the n pixels between the first and the last tone, and
        between the second and the last tone, from the images' phase differences: [2, n]; with only
        two tones, [1, n]."""
        return self.of_pairs(depth_step_m, self.still)

    def of_pairs(
        self, step_m: Callable[[np.ndarray, np.ndarray, float], np.ndarray], images: np.ndarray
    ) -> np.ndarray:
        """Return step_m(image, last image, difference in hertz) of the first and the last tone, and
        of the second and the last: [2, n]; with only two tones, [1, n]. images: [f, n]."""
        last, f = len(images) - 1, self.tones.frequencies_hz
        return np.array(
            [step_m(images[i], images[last], f[i] - f[last]) for i in range(min(2, last))]
        )

    def where(self, chosen: np.ndarray) -> FskStep:
        """Return the imaging step with only some of its pixels, which a mask [n] or indices select;
        its amplitude stays that of all."""
        formed_m, again = self.formed_m, self.again
        return replace(
            self,
            index=self.index[chosen],
            formed_m=formed_m[chosen] if isinstance(formed_m, np.ndarray) else formed_m,
            images=self.images[:, chosen],
            again=None if again is None else again[:, chosen],
        )

    def cropped(self) -> FskStep:
        """Return the imaging step on the smallest rectangular part of its grid that contains all of
        its pixels."""
        on_target = self.on_map(np.array(True), False)
        box = bounding_box(on_target)
        index, amplitude = np.flatnonzero(on_target[box]), self.amplitude[box]
        return replace(self, grid=self.grid.part(box), index=index, amplitude=amplitude)

    def below(self) -> FskStep:
        """Return the imaging step without its last tone: the images at the same points, whose
        phases give depths from fewer tones."""
        return _step(
            self.tones.first(len(self.tones) - 1),
            self.grid,
            self.index,
            self.formed_m,
            self.images[:-1],
            self.again,
        )

    def filtered(self, values: np.ndarray, size_px: int) -> np.ndarray:
        """Average a map [ny, nx] over a window of size_px × size_px, weighted with the pixels'
        power if config.weighted; NaN stays NaN."""
        weighted = isinstance(self.tones.config, RefinedConfig) and self.tones.config.weighted
        return masked_mean(values, size_px, self.amplitude**2 if weighted else None)

    def at(self, values: np.ndarray) -> np.ndarray:
        """Return the values [n] of a map [ny, nx] at the step's pixels."""
        return values.ravel()[self.index]

    def on_map(self, values: np.ndarray, elsewhere: float = np.nan) -> np.ndarray:
        """Return the values [n] of the step's pixels as a map [ny, nx]; all other pixels have the
        value `elsewhere`."""
        return self.grid.on_map(self.index, values, elsewhere)


def _step(
    tones: Tones,
    grid: PixelGrid,
    index: np.ndarray,
    formed_m: float | np.ndarray,
    images: np.ndarray,
    again: np.ndarray | None,
) -> FskStep:
    amplitude = grid.on_map(index, np.abs(images).mean(axis=0), elsewhere=0.0)
    return FskStep(tones, grid, index, formed_m, images, amplitude, again=again)


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] over a window of size_px × size_px around each pixel, leaving out NaN
    (normalised convolution); NaN stays NaN. weight [ny, nx]: weight of each pixel; None for equal
    weights."""
    known = np.isfinite(values)
    if size_px == 1 or not known.any():
        return values.copy()
    weight = known.astype(np.float64) if weight is None else np.where(known, weight, 0.0)
    offset = values[known].mean()  # keeps the sums small, so that they lose no digits
    return np.where(
        known, offset + _window_means(values - offset, weight / weight.max(), size_px), np.nan
    )


@njit(**FAST)
def _window_means(values, weight, size_px):  # type: ignore[no-untyped-def]
    """Compute the weighted mean of a map over the window around each pixel: [ny, nx]. Only pixels
    with weights above 0 count.

    Each window is summed on its own, since a running sum would carry the rounding errors of strong
    pixels to weak ones.
    """
    ny, nx = values.shape
    before, behind = size_px // 2, (size_px - 1) // 2
    along, means, total = np.zeros((2, ny, nx)), np.empty((ny, nx)), np.empty((2, nx))
    weighted = np.zeros(nx)
    for j in range(ny):
        for i in range(nx):
            weighted[i] = weight[j, i] * values[j, i] if weight[j, i] > 0 else 0.0
        for shift in range(-before, behind + 1):
            for i in range(max(-shift, 0), nx - max(shift, 0)):
                along[0, j, i] += weighted[i + shift]
                along[1, j, i] += weight[j, i + shift]
    for j in range(ny):
        total[:] = 0
        for row in range(max(j - before, 0), min(j + behind + 1, ny)):
            for i in range(nx):
                total[0, i] += along[0, row, i]
                total[1, i] += along[1, row, i]
        for i in range(nx):
            means[j, i] = total[0, i] / total[1, i]
    return means
