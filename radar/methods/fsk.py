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
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    Aperture,
    channel_ends,
    lateral_cell_m,
    range_cell_m,
    range_period_m,
    reach_hz,
)
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.data.grid import PixelGrid, VoxelGrid
from handbench.radar.methods.doppler import Repetition, repetition, with_velocity
from handbench.radar.methods.pixels import Pixels, path_gradient_z
from handbench.radar.methods.settings import Depth, MethodSettings, OddPixels
from handbench.support.config import Tone
from handbench.support.errors import HandbenchError

ENOUGH = 8  # tones from which a range profile tells depths apart
PROFILED = 256  # channels, evenly chosen, whose profiles are summed
NEAREST_M = 0.05  # first depth that is considered
FARTHEST_M = 10.0  # last depth that is considered
LENGTHS = 500  # of paths whose waves are held at once
STANDS_OUT = 6.0  # standard deviations of a profile of noise that a peak exceeds
PER_CELL = 5  # pixels along x and y of a resolution cell that show a peak to 3 %
AS_HIGH = 0.8  # of peaks of the profile that differ by less, 1 dB, the nearest one is taken
# a plane whose peak is higher by this factor is in focus: speckle and gloss reach 1.1, a hand 1.24
SHARPER = 1.15


class Fsk(MethodSettings):
    """Settings of FSK; the defaults are the paper's 3-FSK. The filter's size is ours, since the
    paper does not give its own."""

    tones_hz: tuple[Tone, ...] = Field(
        (82.0e9, 81.8e9, 79.5e9), min_length=2, description="the closest pair first"
    )
    first_depth_m: Depth | Literal["auto"] = Field(
        0.45, description="z_e of the first images; auto: where the echoes are"
    )
    corrections: int = Field(
        1, ge=1, le=1000, description="times that z_e is corrected (paper: once)"
    )
    filter_px: OddPixels = Field(
        5, description="averaging filter before each further tone and of the result"
    )
    refinements: int = Field(
        1, ge=1, le=1000, description="times that a further tone corrects each pixel"
    )
    weighted: bool = Field(False, description="the filters weigh each pixel with its power")
    off_axis: bool = Field(False, description="use the path's true derivative along z instead of 2")
    doppler: bool = Field(False, description="a repeated tone gives velocities and corrects depths")
    drop_doubtful: bool = Field(
        False, description="flagged pixels are dropped (NaN) instead of kept"
    )

    @field_validator("tones_hz")
    @classmethod
    def _in_order(cls, tones_hz: tuple[float, ...]) -> tuple[float, ...]:
        distances_hz = [0.0, *(reach_hz(tones_hz[:n]) for n in range(2, len(tones_hz) + 1))]
        if distances_hz != sorted(set(distances_hz)):
            raise ValueError(
                "expected the closest pair first, and each further tone further away from it than "
                "the one before"
            )
        return tones_hz


def depth_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Compute the depth step Δz = −cφ / (4πΔf), metres, from the depth at which two images are
    formed to the depth of the scatterer, by their phase difference φ = arg(O_b conj(O_a)).
    difference_hz: Δf = f_b − f_a."""
    phase = np.angle(image_b.astype(np.complex128) * np.conj(image_a))
    return -SPEED_OF_LIGHT_M_S * phase / (4 * np.pi * difference_hz)


@dataclass(frozen=True)
class FskStep:
    """One imaging step: images of n pixels, and the depths that follow from their phases.

    formed_m [n]: depths at which the images are formed, NaN for pixels that are not imaged, whose
    images are 0; images [f, n]: at the first f tones of the echoes, without the phase of the
    target's motion, if that is measured; again [2, n]: images of the tone that is measured twice
    ([0, n] without one); amplitude [n]: mean magnitude of the tones' images.
    """

    echoes: FskEchoes
    pixels: Pixels
    formed_m: np.ndarray
    images: np.ndarray
    again: np.ndarray
    amplitude: np.ndarray

    def where(self, chosen: np.ndarray) -> FskStep:
        """Return the step with only the pixels chosen [k], positions among the n."""
        of_pixels = ("formed_m", "images", "again", "amplitude")
        chosen_values = {name: getattr(self, name)[..., chosen] for name in of_pixels}
        return replace(self, pixels=self.pixels.where(chosen), **chosen_values)

    @cached_property
    def factor(self) -> np.ndarray | float:
        """Factor of the depth steps: 2 over the growth ∂(|p − t| + |p − r|)/∂z [n] of the path (1.5
        at the corner of the paper's image), or 1 as in the paper."""
        if not self.echoes.config.off_axis:
            return 1.0
        points_m = self.pixels.points_m(self.formed_m)
        return 2 / path_gradient_z(points_m, self.echoes.aperture)

    def steps_m(self, step_m: Callable[..., np.ndarray] = depth_step_m) -> np.ndarray:
        """Return step_m(image, last image, difference in hertz) of the first and the last tone, and
        of the second and the last: [2, n]; with two tones, [1, n]."""
        # the echoes may have further tones
        *first, (last, last_hz) = zip(self.images, self.echoes.frequencies_hz, strict=False)
        return np.array([step_m(image, last, hz - last_hz) for image, hz in first[:2]])

    @cached_property
    def correction_m(self) -> np.ndarray:
        """Depth corrections [n], metres, from formed_m to the scatterers: the mean of `steps_m`."""
        return np.asarray(self.steps_m().mean(axis=0) * self.factor)

    @property
    def z_m(self) -> np.ndarray:
        """Depths after the step [n], metres, NaN for pixels that are not imaged."""
        return self.formed_m + self.correction_m

    def filtered(self, values: np.ndarray) -> np.ndarray:
        """Average values [n] of the pixels by the configured filter (`Pixels.means`)."""
        config = self.echoes.config
        weight = self.amplitude.astype(np.float64) ** 2 if config.weighted else None
        return self.pixels.means(values, config.filter_px, weight)

    def on_target(self) -> FskStep:
        """Do step 3 of the paper's method: keep every pixel at or above the threshold, which takes
        the depth of its own phase."""
        seen = amplitude_db(self.amplitude) >= self.echoes.config.threshold_db
        return self.where(np.flatnonzero(seen))


def fsk(
    capture: RadarCapture,
    config: Fsk,
    frame: int = 0,
    on_step: Callable[[FskStep], np.ndarray] = attrgetter("z_m"),
) -> tuple[DepthMap, list[FskStep]]:
    """Compute the depth map of a frame by 2-FSK, 3-FSK or a longer ladder of tones (Bräunig et al.,
    section II): (map, imaging steps that led to it, all of the same pixels).

    on_step: called after each imaging step; returns the depths [n] in metres from which the next
    step starts, NaN for pixels to leave out (default: the step's own).
    """
    echoes = FskEchoes.of(capture, config, frame)
    plane = echoes.target_plane()
    steps, config = [plane.on_target()], echoes.config
    z_m = on_step(steps[0])
    for count in range(3, len(config.tones_hz) + 1):
        z_m = steps[-1].filtered(z_m)
        for _ in range(config.refinements):
            if not np.isfinite(z_m).any():  # on_step has dropped every pixel
                break
            # 4: the curved surface found so far is imaged at all tones up to this one.
            # 5: the mean of the two corrections between the new tone and the first two.
            steps.append(echoes.surface(steps[0].pixels, z_m, count))
            z_m = on_step(steps[-1])
    step = steps[-1]
    imaged = plane if len(steps) == 1 else step
    depth = DepthMap(
        echoes.grid.x_m,
        echoes.grid.y_m,
        step.pixels.on_map(step.filtered(z_m)),
        imaged.pixels.on_map(amplitude_db(imaged.amplitude), -np.inf).astype(np.float32),
        "fsk",
        config.model_dump(mode="json"),
    )
    if echoes.repetition is not None:
        depth = with_velocity(depth, step, echoes.repetition)
    return depth, steps


class FskEchoes(NamedTuple):
    """The samples [f, …] of one frame at a method's tones frequencies_hz [f]; for velocities the
    first and the last measurement of the repeated tone follow as two more. grid: the pixels of the
    depth map."""

    samples: np.ndarray
    frequencies_hz: np.ndarray
    aperture: Aperture
    config: Fsk
    grid: PixelGrid
    repetition: Repetition | None

    @classmethod
    def of(cls, capture: RadarCapture, config: Fsk, frame: int) -> FskEchoes:
        """Return the configured tones of a frame of a capture, scaled to about 1. Raises
        HandbenchError if a tone was not measured, or, for velocities, none twice."""
        index, repeated = capture.tone_index(config.tones_hz), None
        if config.doppler:
            repeated = repetition(capture, index)
            index = np.append(index, repeated.measured)
        samples, hz = scaled_to_one(capture.samples[frame][index]), capture.vacuum_hz
        echoes = cls(samples, hz[index], capture.aperture, config, config.pixels, repeated)
        if config.first_depth_m != "auto":
            return echoes
        period_m, nearest_m = range_period_m(hz), first_depth_m(capture, frame)
        # where the near field ends, 2D²/λ, and with it focus
        end_m = 2 * echoes.extent_m**2 * hz.max() / SPEED_OF_LIGHT_M_S
        end_m = max(min(end_m, FARTHEST_M), nearest_m + period_m / 2)
        return echoes.in_focus(np.arange(nearest_m, end_m, period_m))

    @property
    def extent_m(self) -> float:
        """The largest extent of the transmitters or receivers along an axis, metres."""
        return max(np.ptp(leg.position_m, axis=0).max() for leg in self.aperture.legs)

    def in_focus(self, depths_m: np.ndarray) -> FskEchoes:
        """Return the echoes with that first depth, of some that have the same phases, whose plane
        has the highest peak. Raises HandbenchError unless it is clearly higher, also when a farther
        plane's peak is divided by its distance, since its wider resolution cells collect more."""
        peaks = np.array([self.strongest(z_m).amplitude.max() for z_m in depths_m])
        best = peaks.argmax()
        others = SHARPER * peaks * np.maximum(1, depths_m[best] / depths_m)
        if np.delete(others > peaks[best], best).any():
            raise HandbenchError(
                f"first_depth_m: is 'auto', but the tones have the same phases at "
                f"{depths_m[0]:.3g} m and every {np.diff(depths_m)[0]:.3g} m behind, and no image "
                "there is clearly the sharpest; give the target's distance in metres"
            )
        first_m = float(depths_m[best])
        return self._replace(config=self.config.model_copy(update={"first_depth_m": first_m}))

    def target_plane(self) -> FskStep:
        """Do steps 1 and 2 of the paper's method: image all pixels of a plane at the first two
        tones, moved to the target by their phase."""
        # 1: the plane z_e is imaged at f1 and f2.
        z_e = float(self.config.first_depth_m)
        for _ in range(self.config.corrections):
            # 2: the phase at the strongest pixel corrects z_e, in the paper once.
            z_e += self.strongest(z_e).correction_m.item()
        return self.plane(z_e)

    def strongest(self, z_m: float) -> FskStep:
        """Image the plane z_m at the first two tones, and return the step of the strongest of its
        pixels, about PER_CELL of which along x and y of a resolution cell are looked at."""
        wavelength_m = SPEED_OF_LIGHT_M_S / self.frequencies_hz[0]
        step_m = lateral_cell_m(wavelength_m, self.extent_m, z_m) / PER_CELL
        thinned = (
            axis[:: max(1, round(len(axis) / max(1, np.ptp(axis) / step_m)))]
            for axis in (self.grid.x_m, self.grid.y_m)
        )
        plane = self._replace(grid=PixelGrid(*thinned)).plane(z_m)
        return plane.where(np.array([plane.amplitude.argmax()]))

    def plane(self, z_m: float) -> FskStep:
        """Image all pixels at one depth z_m and at the first two tones, without a phase that all
        tones share."""
        from handbench.radar.imaging.api import image_volume  # numba, which settings do not need

        voxels = VoxelGrid(self.grid.x_m, self.grid.y_m, np.array([z_m]))
        images = image_volume(*self._tones(2), voxels, self.config.tolerance, True, carrier=False)
        images = images.reshape(len(images), -1)
        count = images.shape[1]
        pixels = Pixels(self.grid, np.arange(count))
        return self._step(pixels, np.full(count, z_m), images, 2)

    def surface(self, pixels: Pixels, z_m: np.ndarray, count: int) -> FskStep:
        """Image n pixels at their finite depths z_m [n] and at the first `count` tones."""
        from handbench.radar.imaging.api import image_points  # numba, which settings do not need

        samples, frequencies_hz, aperture = self._tones(count)
        images = np.zeros((len(samples), len(z_m)), np.complex64)
        on = np.isfinite(z_m)
        points_m = pixels.where(on).points_m(z_m[on])
        images[:, on] = image_points(
            samples, frequencies_hz, aperture, points_m, self.config.tolerance, per_tone=True
        )
        return self._step(pixels, z_m, images, count)

    def _tones(self, count: int) -> tuple[np.ndarray, np.ndarray, Aperture]:
        """Return the echoes at the first `count` tones, and at the tone that is measured twice."""
        rows = np.r_[:count, len(self.config.tones_hz) : len(self.samples)]
        return self.samples[rows], self.frequencies_hz[rows], self.aperture

    def _step(
        self, pixels: Pixels, formed_m: np.ndarray, images: np.ndarray, count: int
    ) -> FskStep:
        images, again = np.split(images, [count])
        amplitude = np.abs(images).mean(axis=0)
        if self.repetition is not None:
            images = self.repetition.at_rest(images, again)
        return FskStep(self, pixels, formed_m, images, again, amplitude)


def first_depth_m(capture: RadarCapture, frame: int = 0) -> float:
    """Find the depth of the strongest target in a frame, metres. Raises HandbenchError for fewer
    than ENOUGH tones, or if no echo stands out from the noise.

    It is the highest peak of the range profile P(z) = Σ_n |Σ_f S_f,n exp(j2πf R_n(z)/c)|² over the
    channels n, or the nearest that is nearly as high: a few tones beside an even sweep hardly tell
    its periods apart. R_n leads over the point straight before the middle of the two antennas.
    """
    tones_hz = np.unique(capture.frequencies_hz)
    if len(tones_hz) < ENOUGH:
        raise HandbenchError(
            f"first_depth_m: is 'auto', but the capture has {len(tones_hz)} tones, and a range "
            f"profile needs {ENOUGH}; give the target's distance in metres"
        )
    silence = HandbenchError(
        f"first_depth_m: is 'auto', but in frame {frame} no echo stands out from the noise; give "
        "the target's distance in metres"
    )
    samples, hz = capture.tones(tones_hz, frame)
    samples = samples.reshape(len(hz), -1)
    live = np.flatnonzero(samples.any(axis=0))
    if not len(live):
        raise silence
    live = live[even_subset(len(live), PROFILED)]
    samples, cell_m = scaled_to_one(samples[:, live]), range_cell_m(hz)
    tx_m, rx_m = (antennas_m[live] for antennas_m in channel_ends(capture.aperture))
    end_m = max(min(range_period_m(hz), FARTHEST_M), NEAREST_M + cell_m)
    depths_m = np.arange(NEAREST_M, end_m, cell_m / 4)
    points_m = (tx_m + rx_m) / 2 + np.multiply.outer(depths_m, [0, 0, 1])[:, None]
    paths_m = np.linalg.norm(points_m - tx_m, axis=2) + np.linalg.norm(points_m - rx_m, axis=2)
    # computed at path lengths a quarter of a cell apart, and linear in between
    lengths_m = np.arange(paths_m.min(), paths_m.max() + cell_m / 4, cell_m / 4)
    turns = np.multiply.outer(lengths_m / SPEED_OF_LIGHT_M_S, hz)
    parts = np.array_split(turns, 1 + len(turns) // LENGTHS)
    at_lengths = np.concatenate([np.abs(np.exp(2j * np.pi * t) @ samples) ** 2 for t in parts])
    each = zip(paths_m.T, at_lengths.T, strict=True)
    power = np.sum([np.interp(path_m, lengths_m, p) for path_m, p in each], axis=0)
    # what leaks from transmitter to receiver falls from the first depth on, and is no peak
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    noise = np.median(power) * (1 + STANDS_OUT / np.sqrt(len(live)))
    if power[peaks].max(initial=0.0) < noise:
        raise silence
    return float(depths_m[peaks[power[peaks] >= AS_HIGH * power[peaks].max()][0]])
