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
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, Aperture
from handbench.radar.data.capture import RadarCapture, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import PixelGrid, VoxelGrid, bounding_box
from handbench.radar.imaging.api import image_points, image_volume
from handbench.radar.imaging.cpu.steering import mean_rise
from handbench.radar.methods.doppler import Repetition, repetition
from handbench.radar.methods.first_depth import with_first_depth
from handbench.radar.methods.fsk_config import AnyConfig, RefinedConfig


class FskStep(NamedTuple):
    """One imaging step of an FSK method: images [f, n] at tones frequencies_hz [f] of n pixels, and
    the depths that follow from their phases.

    index [n]: flat indices of the pixels in grid; formed_m [n]: depths at which the images are
    formed; images: without the phase of the target's motion, if that is measured; amplitude [ny,
    nx]: mean magnitude of the tones' images; factor: of the depth steps, 1 or [n]; again [2, n]:
    images of the tone that is measured twice, if the method uses one.
    """

    grid: PixelGrid
    index: np.ndarray
    formed_m: np.ndarray
    frequencies_hz: np.ndarray
    images: np.ndarray
    amplitude: np.ndarray
    factor: np.ndarray | float
    again: np.ndarray | None

    @property
    def period_m(self) -> float:
        """Smallest distance, metres on the axis, between depths with the same phase difference
        between the last tone and one of the first two: c / 2Δf."""
        *others, last_hz = self.frequencies_hz
        return float(SPEED_OF_LIGHT_M_S / (2 * max(abs(last_hz - hz) for hz in others[:2])))

    def steps_m(
        self, step_m: Callable[[np.ndarray, np.ndarray, float], np.ndarray] | None = None
    ) -> np.ndarray:
        """Return step_m(image, last image, difference in hertz), by default the depth step, of the
        first and the last tone, and of the second and the last: [2, n]; with two tones, [1, n]."""
        f, images, step_m = self.frequencies_hz, self.images, step_m or depth_step_m
        first = range(min(2, len(f) - 1))
        return np.array([step_m(images[i], images[-1], f[i] - f[-1]) for i in first])

    @property
    def correction_m(self) -> np.ndarray:
        """Depth steps [n] from formed_m to the scatterers, metres: the mean of `steps_m`."""
        return np.asarray(self.steps_m().mean(axis=0) * self.factor)

    @property
    def z_m(self) -> np.ndarray:
        """Depths after the step [ny, nx], metres, NaN off target."""
        return self.grid.on_map(self.index, self.formed_m + self.correction_m)

    def filtered(self, values: np.ndarray, size_px: int, weighted: bool) -> np.ndarray:
        """Average a map [ny, nx] by `masked_mean`; weighted: with the pixels' power."""
        return masked_mean(values, size_px, self.amplitude**2 if weighted else None)


def fsk(
    capture: RadarCapture,
    config: AnyConfig,
    frame: int = 0,
    on_step: Callable[[FskStep], np.ndarray] | None = None,
) -> tuple[DepthMap, list[FskStep]]:
    """Compute the depth map of a frame by 2-FSK, 3-FSK or a longer ladder of tones (Bräunig et al.,
    section II): (map, imaging steps that led to it).

    on_step: called after each imaging step; returns the depths [ny, nx] in metres from which the
    next step starts (default: the step's own).
    """
    config = with_first_depth(capture, config, frame)
    tones, on_step = Tones.of(capture, config, frame), on_step or (lambda step: step.z_m)
    # 1 to 3: the plane at f1 and f2, z_e corrected once, depths above the threshold.
    steps = [first_step(tones)]
    z_m = on_step(steps[-1])
    if isinstance(config, RefinedConfig):
        for count in range(3, len(tones.frequencies_hz) + 1):
            z_m = steps[-1].filtered(z_m, config.coarse_filter_px, config.weighted)
            for _ in range(config.fine_refinements):
                if not np.isfinite(z_m).any():  # on_step has dropped every pixel
                    break
                # 4: the curved surface found so far is imaged at all tones up to this one.
                # 5: the mean of the two corrections between the new tone and the first two.
                steps.append(tones.surface(z_m, count))
                z_m = on_step(steps[-1])
        z_m = steps[-1].filtered(z_m, config.fine_filter_px, config.weighted)
    grid, db = tones.grid, amplitude_db(steps[-1].amplitude)
    name = f"{len(tones.frequencies_hz)}fsk"
    depth = DepthMap(grid.x_m, grid.y_m, z_m, db, name, config.model_dump())
    if tones.repeated is not None:
        velocity_m_s, limit_m_s = tones.velocity_m_s(steps[-1]), tones.repeated.limit_m_s
        depth = replace(depth, velocity_m_s=velocity_m_s, velocity_limit_m_s=limit_m_s)
    return depth, steps


def first_step(tones: Tones) -> FskStep:
    """Do steps 1 to 3 of the paper's method: image a plane at the first two tones, move it to the
    target by their phase, and return the imaging step of the pixels that are at or above the
    threshold."""
    # 1: the plane z_e is imaged at f1 and f2.
    z_e = float(tones.config.first_depth_m)
    amplitude, step = tones.plane(z_e)
    for _ in range(tones.config.corrections):
        # 2: the phase at the strongest pixel corrects z_e, in the paper once.
        z_e += float(step(np.array([amplitude.argmax()])).correction_m[0])
        amplitude, step = tones.plane(z_e)
    # 3: every pixel above the threshold takes the depth of its own phase.
    return step(np.flatnonzero(amplitude_db(amplitude) >= tones.config.threshold_db))


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
    the method uses them, with the aperture, the method's configuration and its pixels.

    repeated: the tone that is measured twice, if the method uses it (else None); samples then have
    its later measurement as one more row.
    """

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    config: AnyConfig
    grid: PixelGrid
    repeated: Repetition | None

    @classmethod
    def of(cls, capture: RadarCapture, config: AnyConfig, frame: int) -> Tones:
        """Return the samples of one frame of a capture at the configured tones, scaled to about 1.
        Raises HandbenchError if a tone was not measured, or, for velocities, none twice."""
        samples, frequencies_hz = capture.tones(config.ladder_hz, frame)
        repeated = repetition(capture, config.ladder_hz) if config.doppler else None
        if repeated is not None:
            samples = np.append(samples, capture.samples[frame][repeated.measured[1:]], axis=0)
        samples = scaled_to_one(samples)
        return cls(samples, frequencies_hz, capture.aperture, config, config.grid(), repeated)

    def plane(self, z_m: float) -> tuple[np.ndarray, Callable[[np.ndarray], FskStep]]:
        """Image all pixels of the plane at depth z_m at the first two tones: (mean magnitude [ny,
        nx], function from flat indices [n] to the `FskStep` of these pixels)."""
        voxels = VoxelGrid(self.grid.x_m, self.grid.y_m, np.array([z_m]))

        def image(samples: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
            # without a phase factor that all tones share
            return image_volume(
                samples,
                frequencies_hz,
                self.aperture,
                voxels,
                self.config.tolerance,
                apart=True,
                carrier=False,
            ).reshape(len(samples), -1)

        images, again = self._images(2, image)
        amplitude = np.abs(images).mean(axis=0).reshape(self.grid.shape)

        def step(index: np.ndarray) -> FskStep:
            repeated = None if again is None else again[:, index]
            formed_m = np.full(len(index), z_m)
            return self._step(index, formed_m, images[:, index], repeated, amplitude)

        return amplitude, step

    def surface(self, z_m: np.ndarray, count: int | None = None) -> FskStep:
        """Image the pixels with a finite depth, each at its depth z_m [ny, nx], at the first
        `count` tones (None: all)."""
        index = np.flatnonzero(np.isfinite(z_m))
        formed_m = z_m.ravel()[index]
        points_m, tolerance = self.grid.points_at_m(index, formed_m), self.config.tolerance

        def image(samples: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
            return image_points(
                samples, frequencies_hz, self.aperture, points_m, tolerance, apart=True
            )

        images, again = self._images(count or len(self.frequencies_hz), image)
        amplitude = self.grid.on_map(index, np.abs(images).mean(axis=0), 0.0)
        return self._step(index, formed_m, images, again, amplitude)

    def velocity_m_s(self, step: FskStep) -> np.ndarray:
        """Compute the radial velocities [ny, nx], m/s, NaN off target, from the mean of
        O(T) conj(O(0)) of the repeated tone over the filter of the result. The path grows by less
        than 2 per metre along the line from the array's middle, which is corrected (by 3 % for the
        paper's array at 0.31 m)."""
        assert self.repeated is not None and step.again is not None
        turned = step.again[1].astype(np.complex128) * np.conj(step.again[0])
        size_px = getattr(self.config, "fine_filter_px", 1)
        # of the numbers, not of the angles, which jump where they wrap
        real, imaginary = (
            masked_mean(self.grid.on_map(step.index, part), size_px)
            for part in (turned.real, turned.imag)
        )
        points_m = self.grid.points_at_m(step.index, step.formed_m)
        cosine = points_m[:, 2] / np.linalg.norm(points_m, axis=1)
        along = path_rise(points_m, self.aperture) / cosine
        velocity_m_s = self.repeated.velocity_m_s(real + 1j * imaginary)
        return velocity_m_s * self.grid.on_map(step.index, 2 / along)

    def _images(
        self, count: int, image: Callable[[np.ndarray, np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Image the first tones: (images [count, n], images [2, n] of the tone that is measured
        twice, or None without one). image: function (samples [k, …], frequencies [k]) → [k, n]."""
        if self.repeated is None:
            return image(self.samples[:count], self.frequencies_hz[:count]), None
        tone, hz = self.repeated.tone, self.frequencies_hz
        rows = sorted({*range(count), tone, len(hz)})
        images = image(self.samples[rows], np.append(hz, hz[tone])[rows])
        return images[:count], images[[rows.index(tone), -1]]

    def _step(
        self,
        index: np.ndarray,
        formed_m: np.ndarray,
        images: np.ndarray,
        again: np.ndarray | None,
        amplitude: np.ndarray,
    ) -> FskStep:
        if self.repeated is not None and again is not None:
            images = self.repeated.at_rest(images, again)
        # Off the axis the path grows by less than 2 per metre of depth (by 1.5 at the corner of the
        # paper's image).
        points_m = self.grid.points_at_m(index, formed_m)
        factor = 2 / path_rise(points_m, self.aperture) if self.config.off_axis else 1.0
        hz = self.frequencies_hz[: len(images)]
        return FskStep(self.grid, index, formed_m, hz, images, amplitude, factor, again)


def masked_mean(values: np.ndarray, size_px: int, weight: np.ndarray | None = None) -> np.ndarray:
    """Average a map [ny, nx] over a window of size_px × size_px around each pixel, leaving out NaN
    (normalised convolution); NaN stays NaN. weight [ny, nx]: weight of each pixel; None for equal
    weights."""
    if size_px == 1 or not np.isfinite(values).any():
        return values.copy()
    whole, box = np.full(values.shape, np.nan), bounding_box(np.isfinite(values))
    inner, known = values[box], np.isfinite(values[box])
    weight = np.where(known, 1.0 if weight is None else weight[box], 0.0)
    weight = (weight / weight.max()).astype(np.float64)
    offset = inner[known].mean()  # keeps the sums small, so that they lose no digits
    weighted = weight * np.where(known, inner - offset, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = offset + _window_sums(weighted, size_px) / _window_sums(weight, size_px)
    whole[box] = np.where(known, means, np.nan)
    return whole


def _window_sums(values: np.ndarray, size_px: int) -> np.ndarray:
    """Sum a map over the window around each pixel: [ny, nx]. Each window is summed by itself, since
    a running sum would carry the rounding errors of strong pixels to weak ones."""
    for axis in (1, 0):
        padding = [(0, 0), (0, 0)]
        padding[axis] = (size_px // 2, (size_px - 1) // 2)
        windows = sliding_window_view(np.pad(values, padding), size_px, axis)
        values = sum(windows[..., i] for i in range(size_px))
    return values
