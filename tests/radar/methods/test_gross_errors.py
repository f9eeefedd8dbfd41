"""The probability that a depth is grossly wrong: its formula on a known map, and plain cases."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import LEAST_INCOHERENCE, with_p_gross
from tests.radar.simulated_points import (
    TONES_HZ,
    around,
    exact_capture,
    points_capture,
    surface_points,
)

POINT_M = np.array([0.0, 0.0, 0.28])
PERIOD_M = SPEED_OF_LIGHT_M_S / (2 * 2.5e9)


def odds_of(z_m, db, wrapped):
    """Odds [ny, nx] of a map with σ = 1 mm of an echo from POINT_M."""
    config = Fsk(**around(POINT_M))
    sigma_m = np.full(z_m.shape, 1e-3)
    axes_m = config.x.values_m(), config.y.values_m()
    depth = DepthMap(*axes_m, z_m, db, "3fsk", {}, sigma_m, wrapped)
    p = with_p_gross(depth, exact_capture(POINT_M), config).p_gross.astype(np.float64)
    return p / (1 - p)


def test_its_factors_by_hand():
    """At the point the tones agree. A pixel 20 mm behind it, 2 mm beside it, 20 dB weaker and
    flagged: four times the odds at the point, and at the pixel more than the four factors."""
    shape = Fsk(**around(POINT_M)).pixels.shape
    z_m, db, wrapped = np.full(shape, POINT_M[2]), np.zeros(shape), np.zeros(shape, bool)
    plain = odds_of(z_m, db, wrapped)
    assert plain[12, 12] == pytest.approx(LEAST_INCOHERENCE / 5, rel=1e-5)
    z_m[14, 12], db[14, 12], wrapped[14, 12] = POINT_M[2] + 0.02, -20, True
    odds = odds_of(z_m, db, wrapped)
    assert odds[12, 12] == pytest.approx(4 * plain[12, 12], rel=1e-3)
    assert odds[14, 12] > 4 * 10 * 10 * plain[12, 12]


@pytest.fixture(scope="module")
def plate():
    """3-FSK's map of a plate with a little noise, and what it was made of."""
    config = Fsk(**around(POINT_M, half_m=0.02), first_depth_m=0.3)
    points_m = surface_points(lambda x, y: np.full(x.shape, POINT_M[2]), 0.04, 0.0015)
    capture = points_capture(points_m, phase_noise_rad=0.01)
    return fsk_with_uncertainty(capture, config), capture, config


def test_a_clean_plate_is_trusted(plate):
    trusted = with_p_gross(*plate)
    on = np.isfinite(trusted.z_m)
    assert on.sum() > 100 and np.abs(trusted.z_m[on] - POINT_M[2]).max() < 0.005
    assert np.isnan(trusted.p_gross[~on]).all() and trusted.p_gross.dtype == np.float32
    assert np.quantile(trusted.p_gross[on], 0.95) < 0.01


@pytest.mark.parametrize("sigma", [True, False], ids=["with sigma", "without"])
def test_a_wrong_period_is_doubted(plate, sigma):
    """Nine pixels a period off amid a clean plate, for methods with σ and without."""
    depth, capture, config = plate
    depth = depth if sigma else replace(depth, sigma_m=None, wrapped=None)
    z_m, patch = depth.z_m.copy(), (slice(18, 21), slice(18, 21))
    assert np.isfinite(z_m[patch]).all()
    z_m[patch] += PERIOD_M
    right, wrong = (
        with_p_gross(map_, capture, config).p_gross[patch]
        for map_ in (depth, replace(depth, z_m=z_m))
    )
    assert (wrong > 0.01).all() and (wrong > 50 * right).all()


def test_noise_is_doubted_and_a_depth_behind_the_array_is_wrong(plate):
    _, capture, config = plate
    draws = np.random.default_rng(1).standard_normal((2, *capture.samples.shape)).astype(np.float32)
    noise = RadarCapture(draws[0] + 1j * draws[1], TONES_HZ, capture.aperture)
    depth = with_p_gross(fsk_with_uncertainty(noise, config), noise, config)
    assert np.nanquantile(depth.p_gross, 0.1) > 0.5
    behind = with_p_gross(replace(depth, z_m=-np.abs(depth.z_m)), noise, config)
    assert (behind.p_gross[np.isfinite(behind.z_m)] == 1).all()
