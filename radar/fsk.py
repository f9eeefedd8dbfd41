"""Frequency-shift keying: depth from the phase between images at two or three tones (the paper's iterations).

Under time e^{+jωt} an image formed at z_e of a scatterer at z has φ = arg(O_b · conj(O_a)) = 4π(f_b − f_a)(z_e − z)/c,
so z = z_e − cφ / (4π(f_b − f_a)), unambiguous within ±c/(4(f_b − f_a)). The path's derivative along z, 2 on the
axis, is smaller off it; the paper leaves that out and `off_axis` puts it in.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field
from scipy.ndimage import uniform_filter

from radar.arrays import SPEED_OF_LIGHT_M_S, Aperture
from radar.backprojection import tone_images
from radar.capture import RadarCapture
from radar.config import Config
from radar.depthmap import DepthMap, amplitude_db
from radar.grid import Axis, PixelGrid

PAPER_LATERAL = Axis(start_m=-0.15, stop_m=0.15, step_m=0.001)

MAX_IMAGES = 6  # passes of the coarse stage; the paper's two suffice for a hand



def _odd(size_px: int) -> int:
    if size_px < 1 or size_px % 2 == 0:
        raise ValueError("expected an odd number ≥ 1: an even window would shift the map by half a pixel")
    return size_px


OddPixels = Annotated[int, AfterValidator(_odd)]


class TwoToneConfig(Config):
    """2-FSK with the paper's parameters."""

    f1_hz: float = Field(default=82.0e9, gt=0, description="first tone")
    f2_hz: float = Field(default=81.8e9, gt=0, description="second tone; |f1 − f2| sets the unambiguous range")
    x: Axis = PAPER_LATERAL
    y: Axis = PAPER_LATERAL
    first_depth_m: float = Field(default=0.45, gt=0, description="z_e of the first images")
    threshold_db: float = Field(default=-10.0, lt=0, description="pixels weaker than this are off target")
    settled_m: float = Field(default=0.005, gt=0, description="z_e is corrected again while it moves by more than this")
    off_axis: bool = Field(default=False, description="use the path's true derivative along z instead of 2")


class ThreeToneConfig(TwoToneConfig):
    """3-FSK with the paper's parameters; the paper does not give its filters' sizes."""

    f3_hz: float = Field(default=79.5e9, gt=0, description="third tone, far from the other two")
    coarse_filter_px: OddPixels = Field(default=5, description="averaging filter of the coarse depth, pixels")
    fine_filter_px: OddPixels = Field(default=5, description="averaging filter of the result, pixels")
    fine_refinements: int = Field(default=1, ge=1, description="times the third tone corrects each pixel (paper: once)")


def depth_step_m(image_b: np.ndarray, image_a: np.ndarray, difference_hz: float) -> np.ndarray:
    """Δz = −cφ / (4π(f_b − f_a)) with φ = arg(O_b conj(O_a)) and difference_hz = f_b − f_a; metres."""
    phase = np.angle(image_b.astype(np.complex128) * np.conj(image_a))
    return -SPEED_OF_LIGHT_M_S * phase / (4 * np.pi * difference_hz)


def stretch(points_m: np.ndarray, aperture: Aperture, off_axis: bool) -> np.ndarray | float:
    """What Δz is multiplied by at points [..., 3]: 1 in the paper; else 2 over d(|p − t| + |p − r|)/dz, averaged
    over the antennas: 1 on the axis far away, 1.3 at the corner of the paper's image."""
    if not off_axis:
        return 1.0
    derivative = np.zeros(points_m.shape[:-1])
    for leg in aperture.legs_m:
        for antenna in leg:
            towards = points_m - antenna
            derivative += towards[..., 2] / np.linalg.norm(towards, axis=-1) / len(leg)
    return 2 / derivative


def two_tone(capture: RadarCapture, config: TwoToneConfig, frame: int = 0) -> DepthMap:
    """The paper's 2-FSK: Δz at the strongest pixel corrects z_e, then Δz is taken at every pixel above the threshold.

    The paper corrects z_e once, which settles a target near the axis; a target far off it takes a pass or two more.
    """
    samples, frequencies_hz = capture.tones([config.f1_hz, config.f2_hz], frame)
    grid = PixelGrid(config.x.values_m(), config.y.values_m())
    z_e, correction_m = config.first_depth_m, 0.0
    for images in range(MAX_IMAGES):
        z_e += correction_m
        points = grid.points_m(z_e)
        amplitude, step_m = _image_pair(samples, frequencies_hz, capture.aperture, points)
        strongest = np.unravel_index(amplitude.argmax(), grid.shape)
        correction_m = float(step_m[strongest] * stretch(points[strongest], capture.aperture, config.off_axis))
        if images > 0 and abs(correction_m) < config.settled_m:
            break
    db = amplitude_db(amplitude)
    on_target = db >= config.threshold_db
    z_m = np.full(grid.shape, np.nan)
    z_m[on_target] = z_e + step_m[on_target] * stretch(points[on_target], capture.aperture, config.off_axis)
    return DepthMap(grid.x_m, grid.y_m, z_m, db, "2fsk", config.model_dump())


def three_tone(capture: RadarCapture, config: ThreeToneConfig, frame: int = 0) -> DepthMap:
    """The paper's 3-FSK: the smoothed 2-FSK depth becomes a point cloud, imaged at all three tones; the mean of Δz from
    (f3, f1) and (f3, f2) corrects it; an averaging filter comes last."""
    coarse = two_tone(capture, TwoToneConfig(**config.model_dump(include=set(TwoToneConfig.model_fields))), frame)
    samples, frequencies_hz = capture.tones([config.f1_hz, config.f2_hz, config.f3_hz], frame)
    grid = PixelGrid(coarse.x_m, coarse.y_m)
    z_m = masked_mean(coarse.z_m, config.coarse_filter_px)
    on_target = np.isfinite(z_m)
    for _ in range(config.fine_refinements):
        points = grid.points_m(z_m)[on_target]
        images = tone_images(samples, frequencies_hz, capture.aperture, points)
        step_m = _third_tone_step_m(images, frequencies_hz)
        z_m[on_target] += step_m * stretch(points, capture.aperture, config.off_axis)

    amplitude = np.zeros(grid.shape)
    amplitude[on_target] = np.abs(images).mean(axis=0)
    fine = masked_mean(z_m, config.fine_filter_px)
    return DepthMap(grid.x_m, grid.y_m, fine, amplitude_db(amplitude), "3fsk", config.model_dump())


def _image_pair(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude and Δz of the images of two tones at points [ny, nx, 3]."""
    shape = points_m.shape[:-1]
    o1, o2 = tone_images(samples, frequencies_hz, aperture, points_m.reshape(-1, 3)).reshape(2, *shape)
    return (np.abs(o1) + np.abs(o2)) / 2, depth_step_m(o1, o2, frequencies_hz[0] - frequencies_hz[1])


def _third_tone_step_m(images: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
    """Mean of Δz from (f3, f1) and (f3, f2) for images [3, n]."""
    (o1, o2, o3), (f1, f2, f3) = images, frequencies_hz
    return (depth_step_m(o1, o3, f1 - f3) + depth_step_m(o2, o3, f2 - f3)) / 2


def masked_mean(values: np.ndarray, size_px: int) -> np.ndarray:
    """Averaging filter over the finite neighbours in a size × size window; NaN stays NaN (normalised convolution)."""
    known = np.isfinite(values)
    if size_px == 1 or not known.any():
        return values.copy()
    offset = values[known].mean()  # keeps the running sums small, so that they lose no digits
    total = uniform_filter(np.where(known, values - offset, 0.0), size_px, mode="constant")
    count = uniform_filter(known.astype(np.float64), size_px, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, offset + total / count, np.nan)

