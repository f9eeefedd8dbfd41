"""Images of captures that lack pairs, of lists of pairs and of waves in a medium, against sums in
float64 over the pairs that are there, with the wave's own speed."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging.api import image_points, image_volume, project_volume
from handbench.radar.methods.pixels import path_gradient_z
from handbench.radar.methods.registry import method
from tests.radar.direct_sums import direct_echoes, direct_sum
from tests.radar.samples import noise, relative_error

pytestmark = pytest.mark.usefixtures("planned")

SINGLE = 3e-6  # relative error of sums in single precision, several times what was measured
ARRAY = qar50()
THERE = np.random.default_rng(5).random(ARRAY.channels) > 0.3  # 30 % of the pairs missing at random
PARTLY = AntennaArray(ARRAY.tx_m, ARRAY.rx_m, THERE)
TONES_HZ = np.array([82e9, 81.8e9, 79.5e9])
GRID = VoxelGrid(1e-3 * np.arange(-20, 20), 1e-3 * np.arange(-15, 15), 0.3 + 1e-3 * np.arange(4))


@pytest.mark.parametrize("tolerance", [None, 1e-3, 1e-5])
def test_points_and_volumes_are_sums_over_the_pairs_that_are_there(tolerance):
    """White noise, the hardest samples; direct and planned; the error is the tolerance or single
    precision."""
    samples = np.where(THERE, noise((3, *ARRAY.channels)), 0)
    volume = image_volume(samples, TONES_HZ, PARTLY, GRID, tolerance)
    some = np.random.default_rng(0).integers(0, volume.size, 60)
    points_m = GRID.points_at_m(some)
    tones = direct_sum(samples, TONES_HZ, ARRAY, points_m, apart=True)
    allowed = tolerance or SINGLE
    assert relative_error(volume.ravel()[some], sum(tones)) < allowed
    images = image_points(samples, TONES_HZ, PARTLY, points_m, tolerance, per_tone=True)
    assert relative_error(images, tones) < allowed


@pytest.mark.parametrize("id", ["2fsk", "3fsk", "nfsk", "joint", "broadband", "narrowband"])
def test_every_method_finds_a_point_without_three_tenths_of_the_pairs(id):
    point_m = np.array([0.004, -0.003, 0.29])
    tones_hz = np.unique([*np.linspace(72e9, 82e9, 26), 81.3e9, 80.5e9, 77e9, 81.8e9, 79.5e9])
    samples = np.where(THERE, direct_echoes(point_m[None], [1.0], tones_hz, ARRAY), 0)
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, PARTLY)
    axis = Axis(start_m=-0.01, stop_m=0.01, step_m=1e-3)
    values = {"x": axis, "y": axis, "tolerance": 1e-4} | (
        {"tones_hz": {"count": 26}} if id == "broadband" else {}
    )
    depth = method(id).run(capture, method(id).configure(values, "test"), 0)
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    assert (depth.x_m[column], depth.y_m[row]) == pytest.approx(point_m[:2], abs=1e-9)
    # Voxels are 1 mm apart; 2-FSK errs by 2 mm in focus, for the paper takes the path's slope as 2.
    assert depth.z_m[row, column] == pytest.approx(point_m[2], abs={"2fsk": 4e-3}.get(id, 1e-3))


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_a_list_of_pairs_is_summed_pair_by_pair(tolerance):
    places_m = np.c_[np.random.default_rng(1).uniform(-0.05, 0.05, (40, 2)), np.zeros(40)]
    scan, samples = AntennaPairs(places_m, places_m + [0.02, 0.01, 0.0]), noise((3, 40))
    volume = image_volume(samples, TONES_HZ, scan, GRID, tolerance)
    expected = direct_sum(samples, TONES_HZ, scan, GRID.points_m().reshape(-1, 3))
    allowed = tolerance or SINGLE
    assert relative_error(volume.ravel(), expected) < allowed
    _, (_, magnitude, _) = project_volume(samples, TONES_HZ, scan, GRID, tolerance)
    reference = np.abs(expected.reshape(GRID.shape))
    np.testing.assert_allclose(magnitude, reference.max(axis=0), atol=allowed * reference.max())


def test_a_point_in_water_is_imaged_where_it_is():
    """Tones are found by their true frequencies; at a speed v they have the phases of f·c/v in
    vacuum."""
    speed, tones_hz, point_m = 3.3e7, np.linspace(2e9, 4e9, 9), np.array([0.01, 0.02, 0.12])
    few = AntennaArray(ARRAY.tx_m[::6], ARRAY.rx_m[::6])
    samples = direct_echoes(point_m[None], [1.0], tones_hz * 299_792_458.0 / speed, few)
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, few, speed)
    axis = {"start_m": -0.02, "stop_m": 0.04, "step_m": 0.005}
    values = {"x": axis, "y": axis, "z": {"start_m": 0.1, "stop_m": 0.14, "step_m": 0.005}}
    values |= {"tones_hz": {"start_hz": 2e9, "stop_hz": 4e9, "count": 9}}
    broadband = method("broadband")
    depth = broadband.run(capture, broadband.configure(values, "test"), 0)
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    np.testing.assert_allclose(
        [depth.x_m[column], depth.y_m[row], depth.z_m[row, column]], point_m, atol=1e-9
    )


def test_the_path_s_rise_is_that_of_the_pairs():
    """The mean over the pairs that are there, pair by pair."""
    there = np.array([[True, False], [True, True], [False, False]])
    tx_m, rx_m = np.eye(3) * 0.1, np.array([[0.0, 0.05, 0.0], [0.2, 0.0, 0.0]])
    p = np.array([0.01, 0.02, 0.3])
    rises = [
        sum(0.3 / np.linalg.norm(p - [*end[:2], 0]) for end in (tx_m[t], rx_m[r]))
        for t, r in np.argwhere(there)
    ]
    found = path_gradient_z(p[None], AntennaArray(tx_m, rx_m, there))[0]
    assert found == pytest.approx(np.mean(rises), rel=1e-12)
