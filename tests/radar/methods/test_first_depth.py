"""`first_depth_m = "auto"`: FSK methods begin where the echoes are."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.first_depth import first_depth_m
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.radar.simulated_points import exact_capture

SWEEP_HZ = np.linspace(72e9, 82e9, 64)
BESIDE_HZ = np.r_[SWEEP_HZ, 81.8e9, 79.5e9]
PIXELS = {axis: {"start_m": -0.03, "stop_m": 0.03, "step_m": 0.002} for axis in "xy"}


@pytest.mark.parametrize(
    ("tones_hz", "z_m", "off_m"),
    [
        (SWEEP_HZ, 0.2, 0.015),  # a range cell; far less than tones leave open
        (SWEEP_HZ, 0.7, 0.015),
        (BESIDE_HZ, 0.31, 0.015),  # the two tones hardly change the profile a period, 0.94 m, away
    ],
)
def test_it_is_where_a_point_is(tones_hz, z_m, off_m):
    capture = exact_capture((0.01, -0.01, z_m), tones_hz)
    assert first_depth_m(capture) == pytest.approx(z_m, abs=off_m)


def test_a_method_begins_there():
    """The point at 0.85 m is more than 375 mm from the paper's first depth, so that 3-FSK takes it
    for one a period away."""
    capture = exact_capture((0.0, 0.0, 0.85), BESIDE_HZ)
    maps = [
        method("3fsk").run(capture, Fsk(**PIXELS, first_depth_m=begun), 0)
        for begun in (0.45, "auto")
    ]
    nearest_m = [depth.z_m[15, 15] for depth in maps]
    assert nearest_m[1] == pytest.approx(0.85, abs=1e-3) and abs(nearest_m[0] - 0.85) > 0.5
    assert maps[1].config["first_depth_m"] == pytest.approx(0.85, abs=0.015)


@pytest.mark.parametrize(
    ("tones_hz", "words"),
    [(SWEEP_HZ, "no echo stands out from the noise"), (SWEEP_HZ[:3], "has 3 tones")],
)
def test_noise_and_few_tones_have_no_first_depth(tones_hz, words):
    noise = np.random.default_rng(1).normal(size=(2, 1, len(tones_hz), 94, 94))
    capture = RadarCapture((noise[0] + 1j * noise[1]).astype(np.complex64), tones_hz, qar50())
    with pytest.raises(HandbenchError, match=words):
        first_depth_m(capture)


@pytest.mark.parametrize("count", [22, 75, 127])
def test_a_scan_whose_paths_are_whole_steps_has_a_first_depth(count):
    """Transmitter and receiver share a place, so that all paths are multiples of the profile's
    step, and rounding decides in which step the last one is."""
    places_m = np.stack([*np.meshgrid(*[np.linspace(-0.05, 0.05, 6)] * 2), np.zeros((6, 6))], -1)
    scan, tones_hz = (
        AntennaPairs(places_m.reshape(-1, 3), places_m.reshape(-1, 3)),
        60e9 + 25e6 * np.arange(count),
    )
    path_m = 2 * np.linalg.norm(scan.tx_m - [0, 0, 0.4], axis=1)
    samples = np.exp(-2j * np.pi * np.multiply.outer(tones_hz, path_m / SPEED_OF_LIGHT_M_S))
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, scan)
    off_m = abs(first_depth_m(capture) - 0.4)
    assert off_m < SPEED_OF_LIGHT_M_S / 2 / np.ptp(tones_hz) / 2
