"""The lens: circles of confusion, rays through the aperture, blur that keeps the light."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from handbench.bench.scenes.lens import ThinLens, disc_kernel, line_kernel
from handbench.bench.scenes.photographs import Studio

Ball = Callable[..., Studio]


def moments(kernel: np.ndarray) -> tuple[float, float, float, float]:
    """Sum, variance along x, variance along y, covariance."""
    y, x = np.indices(kernel.shape) - (np.array(kernel.shape) // 2)[:, None, None]
    return tuple((kernel * part).sum() for part in (1, x**2, y**2, x * y))


def test_circle_of_confusion_is_the_textbooks(ball: Ball) -> None:
    camera = ball.scene().cameras[0]
    pixel_m, focus_m, f_number = 0.036 / camera.width, 0.5, 4.0
    lens = ThinLens.of(camera, f_number, 0.036, focus_m)
    focal_m = 1 / (1 / focus_m + 1 / (camera.params[0] * pixel_m))
    depth_m = np.array([0.3, 0.5, 0.6, np.inf])
    # Greenleaf 1950: c = |z - s| / z · f² / (N (s - f)) on the sensor.
    expected_m = np.array([2 / 3, 0, 1 / 6, 1]) * focal_m**2 / (f_number * (focus_m - focal_m))
    assert lens.circle_px(depth_m) == pytest.approx(expected_m / pixel_m, abs=1e-9)


@pytest.mark.parametrize("size_px", [0.7, 1.0, 3.3, 12.0])
def test_kernels_keep_light_and_have_the_right_width(size_px: float) -> None:
    disc_px2, line_px2 = size_px**2 / 16, size_px**2 / 12
    expected = (1, disc_px2, disc_px2, 0)
    assert moments(disc_kernel(size_px)) == pytest.approx(expected, rel=0.01, abs=1e-6)
    total, x, y, xy = moments(line_kernel(size_px, np.radians(30)))
    assert (total, x + y) == pytest.approx((1, line_px2), rel=0.01)
    assert x * 0.25 + y * 0.75 - xy * np.sqrt(0.75) == pytest.approx(0, abs=1e-6)  # across


def test_blurred_picture_is_that_of_the_lens(ball: Ball) -> None:
    studio = ball(f_number=1.4, sensor_width_mm=100, focus_m=0.44, texture_contrast=0.0)
    camera = ball.scene().cameras[0]
    directions = camera.ray_directions()
    everywhere = np.ones(directions.shape[:2], bool)
    exact = studio._through_lens(camera, studio.lens(camera), directions, everywhere)
    inside = (slice(8, -8), slice(8, -8))
    exact, fast, sharp = (
        picture.reshape(directions.shape)[inside]
        for picture in (exact, studio.expose(camera), studio.shoot(camera.centre_m, directions)[0])
    )
    error, effect = (np.sqrt(((other - exact) ** 2).mean()) for other in (fast, sharp))
    assert error < 0.01 < 0.1 < effect
    assert fast.mean() == pytest.approx(exact.mean(), rel=2e-3)
