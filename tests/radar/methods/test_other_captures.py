"""Methods on captures that lack pairs and on waves in a medium."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.pixels import path_gradient_z
from tests.radar.direct_sums import direct_echoes
from tests.radar.simulated_points import around, depth_by


def test_a_point_in_water_is_imaged_where_it_is():
    """Tones are found by their true frequencies; at a speed v they have the phases of f·c/v in
    vacuum."""
    speed, tones_hz, point_m = 3.3e7, np.linspace(2e9, 4e9, 9), np.array([0.01, 0.02, 0.12])
    few = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])
    vacuum_hz = tones_hz * SPEED_OF_LIGHT_M_S / speed
    samples = direct_echoes(point_m[None], np.ones(1), vacuum_hz, few)
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, few, speed)
    values = {
        "z": {"start_m": 0.1, "stop_m": 0.14, "step_m": 0.005},
        "tones_hz": {"start_hz": 2e9, "stop_hz": 4e9, "count": 9},
    }
    depth = depth_by("broadband", capture, around(point_m, 0.03, 0.005), **values)
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    place_m = depth.x_m[column], depth.y_m[row], depth.z_m[row, column]
    assert place_m == pytest.approx(point_m, abs=1e-9)


def test_the_path_s_rise_is_that_of_the_pairs():
    """The mean over the pairs that are there, pair by pair."""
    there = np.array([[True, False], [True, True], [False, False]])
    tx_m, rx_m = np.eye(3) * 0.1, np.array([[0.0, 0.05, 0.0], [0.2, 0.0, 0.0]])
    p = np.array([0.01, 0.02, 0.3])
    rises = [
        sum((p - end_m)[2] / np.linalg.norm(p - end_m) for end_m in (tx_m[t], rx_m[r]))
        for t, r in np.argwhere(there)
    ]
    rise = path_gradient_z(p[None], AntennaArray(tx_m, rx_m, there))[0]
    assert rise == pytest.approx(np.mean(rises), rel=1e-12)
