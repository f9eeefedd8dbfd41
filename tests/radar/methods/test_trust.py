"""The probability that a depth is grossly wrong: its features on known maps, and what it says of
plain cases."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.methods.depth_uncertainty import (
    FEATURES,
    features,
    fsk_with_uncertainty,
    known_weights,
    probability,
    weights_of,
    with_p_gross,
)
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.registry import methods
from tests.radar.simulated_points import (
    TONES_HZ,
    around,
    point_capture,
    points_capture,
    surface_points,
)

POINT_M = np.array([0.0, 0.0, 0.28])
CONFIG = ThreeToneConfig(**around(POINT_M), first_depth_m=0.28)
PERIOD_M = SPEED_OF_LIGHT_M_S / (2 * 2.5e9)


def flat(z_m=0.28, amplitude_db=None):
    """A map of one depth on CONFIG's pixels."""
    shape = CONFIG.grid().shape
    db = np.zeros(shape) if amplitude_db is None else amplitude_db
    return DepthMap(CONFIG.x.values_m(), CONFIG.y.values_m(), np.full(shape, z_m), db, "3fsk")


def feature_map(depth, name, capture=None):
    """One feature [ny, nx] of a map of all pixels."""
    index, found = features(depth, capture or point_capture(POINT_M), CONFIG)
    assert np.array_equal(index, np.arange(depth.z_m.size))
    return found[:, FEATURES.index(name)].reshape(depth.z_m.shape)


def test_neighbours_and_islands_by_hand():
    """One pixel 20 mm behind the others, 12 dB below them: behind all that is beside it, and an
    island of its own."""
    z_m, db = np.full(CONFIG.grid().shape, 0.28), np.zeros(CONFIG.grid().shape)
    z_m[10, 10] += 0.02
    db[10, 10] = -12
    depth = replace(flat(amplitude_db=db), z_m=z_m)
    names = ("range", "behind", "before", "below", "island")
    [at, beside, far] = [
        [feature_map(depth, name)[place] for name in names] for place in ((10, 10), (11, 9), (0, 0))
    ]
    step = np.log10(20 / 5)
    assert at == pytest.approx([step, step, 0, 1.2, 1.2], abs=1e-4)
    assert beside == pytest.approx([step, 0, step, 0, 0], abs=1e-4)
    assert far == pytest.approx([-2, 0, 0, 0, 0], abs=1e-4)


def test_every_method_has_weights_and_a_variant_those_of_its_base():
    assert {"any", "2fsk", "3fsk", "nfsk", "broadband", "narrowband"} <= set(known_weights())
    for method in methods():
        assert np.isfinite(weights_of(method.id)).all()
    assert np.array_equal(weights_of("3fsk-offaxis"), known_weights()["3fsk"])
    assert np.array_equal(weights_of("somebody-s"), known_weights()["any"])
    assert probability(np.zeros((1, len(FEATURES))), np.zeros(1 + len(FEATURES))) == 0.5


@pytest.fixture(scope="module")
def plate():
    """3-FSK's map of a plate with a little noise, and what it was made of."""
    config = ThreeToneConfig(**around(POINT_M, half_m=0.02), first_depth_m=0.3)
    points_m = surface_points(lambda x, y: np.full(x.shape, POINT_M[2]), 0.04, 0.0015)
    capture = points_capture(points_m, phase_noise_rad=0.01)
    return fsk_with_uncertainty(capture, config), capture, config


def test_a_clean_plate_is_trusted(plate):
    trusted = with_p_gross(*plate)
    on = np.isfinite(trusted.z_m)
    assert on.sum() > 100 and np.abs(trusted.z_m[on] - POINT_M[2]).max() < 0.005
    assert np.isnan(trusted.p_gross[~on]).all() and trusted.p_gross.dtype == np.float32
    assert np.quantile(trusted.p_gross[on], 0.95) < 0.01


def test_a_wrong_period_is_doubted(plate):
    """Nine pixels a period off amid a plate that is clean: a hundred times what they had, and no
    silent error."""
    depth, capture, config = plate
    z_m, patch = depth.z_m.copy(), (slice(18, 21), slice(18, 21))
    assert np.isfinite(z_m[patch]).all()
    z_m[patch] += PERIOD_M
    before, after = (
        with_p_gross(map_, capture, config).p_gross[patch]
        for map_ in (depth, replace(depth, z_m=z_m))
    )
    assert (after > 0.01).all() and (after > 50 * before).all()


def test_a_pixel_that_the_method_flags_is_doubted_as_much(plate):
    """The other pixels keep their p_gross."""
    depth, capture, config = plate
    flags = np.zeros(depth.z_m.shape, bool)
    flags[18:21, 18:21] = True
    before, after = (
        with_p_gross(replace(depth, wrapped=of), capture, config).p_gross
        for of in (np.zeros_like(flags), flags)
    )
    assert (before[flags] < config.wrap_probability).all()
    assert (after[flags] >= np.float32(config.wrap_probability)).all()
    assert np.array_equal(after[~flags], before[~flags], equal_nan=True)


def test_noise_is_not_and_a_depth_behind_the_array_never(plate):
    _, capture, config = plate
    draws = np.random.default_rng(1).standard_normal((2, *capture.samples.shape)).astype(np.float32)
    noise = RadarCapture(draws[0] + 1j * draws[1], TONES_HZ, capture.aperture)
    depth = with_p_gross(fsk_with_uncertainty(noise, config), noise, config)
    assert np.nanquantile(depth.p_gross, 0.1) > 0.5
    behind = with_p_gross(replace(depth, z_m=-np.abs(depth.z_m)), noise, config)
    assert (behind.p_gross[np.isfinite(behind.z_m)] == 1).all()


def test_it_survives_the_file(tmp_path, plate):
    depth = with_p_gross(*plate)
    depth.save(tmp_path / "depth.npz")
    again = load_depthmap(tmp_path / "depth.npz")
    assert np.array_equal(again.p_gross, depth.p_gross, equal_nan=True)
