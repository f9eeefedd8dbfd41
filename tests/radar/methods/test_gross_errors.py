"""The probability that a depth is grossly wrong: its formula on a known map, and plain cases."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import LEAST_INCOHERENCE, with_p_gross
from tests.radar.samples import noise
from tests.radar.simulated_points import around, exact_capture, points_capture, surface_points

POINT_M = np.array([0.0, 0.0, 0.28])
PERIOD_M = SPEED_OF_LIGHT_M_S / (2 * 2.5e9)


def test_its_factors_by_hand():
    """At the point the tones agree. A pixel 20 mm behind it, 2 mm beside it, 20 dB weaker and
    flagged: four times the odds at the point, and at the pixel more than the four factors."""
    config, capture = Fsk(**around(POINT_M)), exact_capture(POINT_M)

    def odds(*maps):
        axes_m = config.x.values_m(), config.y.values_m()
        depth = DepthMap(*axes_m, *maps[:2], "3fsk", {}, np.full(maps[0].shape, 1e-3), maps[2])
        p = with_p_gross(depth, capture, config).p_gross.astype(np.float64)
        return p / (1 - p)

    shape = config.pixels.shape
    z_m, db, wrapped = np.full(shape, POINT_M[2]), np.zeros(shape), np.zeros(shape, bool)
    plain = odds(z_m, db, wrapped)
    assert plain[12, 12] == pytest.approx(LEAST_INCOHERENCE / 5, rel=1e-5)
    z_m[14, 12], db[14, 12], wrapped[14, 12] = POINT_M[2] + 0.02, -20, True
    worse = odds(z_m, db, wrapped)
    assert worse[12, 12] == pytest.approx(4 * plain[12, 12], rel=1e-3)
    assert worse[14, 12] > 4 * 10 * 10 * plain[12, 12]


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
    patch, off_m = (slice(18, 21), slice(18, 21)), np.zeros(depth.z_m.shape)
    off_m[patch] = PERIOD_M
    right, wrong = (
        with_p_gross(replace(depth, z_m=z_m), capture, config).p_gross[patch]
        for z_m in (depth.z_m, depth.z_m + off_m)
    )
    assert (wrong > 0.01).all() and (wrong > 50 * right).all()


def test_noise_is_doubted_and_a_depth_behind_the_array_is_wrong(plate):
    _, capture, config = plate
    blind = replace(capture, samples=noise(capture.samples.shape, 1))
    depth = with_p_gross(fsk_with_uncertainty(blind, config), blind, config)
    assert np.nanquantile(depth.p_gross, 0.1) > 0.5
    behind = with_p_gross(replace(depth, z_m=-np.abs(depth.z_m)), blind, config)
    assert (behind.p_gross[np.isfinite(behind.z_m)] == 1).all()
