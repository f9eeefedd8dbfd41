"""What moves a depth: a tone's phase by what theory says, and single precision by nothing that a
figure shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.imaging import api
from handbench.radar.methods.registry import method
from tests.radar.direct_sums import direct_sum
from tests.radar.simulated_points import (
    around,
    bumpy,
    error_m,
    point_capture,
    points_capture,
    strongest_z_m,
    surface_points,
)

POINT_M, STEP_RAD = np.array([0.0, 0.0, 0.3]), 1e-3
FINE_HZ = 2 / (1 / 2.5e9 + 1 / 2.3e9)  # of the third tone against both others


@pytest.mark.parametrize(
    ("id", "last_hz", "difference_hz"), [("2fsk", 81.8e9, 0.2e9), ("3fsk", 79.5e9, FINE_HZ)]
)
def test_a_phase_moves_a_depth_by_the_wavelength_of_the_difference(id, last_hz, difference_hz):
    """By c/(2πΔf) over the path's slope, the mean over the antennas."""
    capture, chosen = point_capture(POINT_M), method(id)
    known = {"off_axis": True, "first_depth_m": 0.3}
    config = chosen.configure(around(POINT_M) | known, "test")

    def depth_m(phase_rad):
        turn = np.where(capture.frequencies_hz == last_hz, phase_rad, 0.0)[:, None, None]
        samples = (capture.samples * np.exp(1j * turn)).astype(np.complex64)
        return strongest_z_m(chosen.run(replace(capture, samples=samples), config, 0))

    moved_m = abs(depth_m(STEP_RAD) - depth_m(-STEP_RAD)) / 2
    legs_m = (POINT_M - side_m for side_m in (capture.aperture.tx_m, capture.aperture.rx_m))
    slope = sum((leg_m[:, 2] / np.linalg.norm(leg_m, axis=1)).mean() for leg_m in legs_m)
    theory_m = STEP_RAD * SPEED_OF_LIGHT_M_S / (2 * np.pi * difference_hz) / slope
    assert moved_m == pytest.approx(theory_m, rel=0.01)


def test_images_in_double_precision_change_no_figure_s_fourth_digit(monkeypatch):
    """Against sums written apart."""
    points_m = surface_points(bumpy, 0.012, 0.003)
    capture, chosen = points_capture(points_m, phase_noise_rad=0.03), method("3fsk")
    config = chosen.configure(around(POINT_M, step_m=0.002), "test")

    def figures():
        off_m = np.abs(error_m(chosen.run(capture, config, 0), bumpy))
        return np.array([np.nanmean(off_m), np.nanmax(off_m)])

    def points(samples, tones_hz, aperture, points_m, *_, **__):
        return direct_sum(samples, tones_hz, aperture, points_m, apart=True)

    def plane(samples, tones_hz, aperture, grid, *_, **__):
        found = points(samples, tones_hz, aperture, grid.points_m().reshape(-1, 3))
        return found.reshape(-1, *grid.shape)

    single = figures()
    monkeypatch.setattr(api, "image_points", points)
    monkeypatch.setattr(api, "image_volume", plane)
    np.testing.assert_allclose(figures(), single, rtol=1e-4)
