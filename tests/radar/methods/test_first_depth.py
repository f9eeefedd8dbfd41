"""`first_depth_m = "auto"`: FSK methods begin where the echoes are."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, qar50, range_cell_m
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.fsk import first_depth_m
from tests.radar.samples import noise
from tests.radar.simulated_points import around, depth_by, exact_capture
from tests.refusals import refuse

SWEEP_HZ = np.linspace(72e9, 82e9, 64)
BESIDE_HZ = np.r_[SWEEP_HZ, 81.8e9, 79.5e9]
UNEVEN_HZ = 1e9 * np.array([77.9, 78.8, 79.5, 80.2, 80.9, 81.37, 81.8, 82.0])


@pytest.mark.parametrize(
    ("tones_hz", "z_m"),
    [
        (SWEEP_HZ, 0.2),
        (SWEEP_HZ, 0.7),
        (BESIDE_HZ, 0.31),  # the two tones hardly change the profile a period, 0.94 m, away
        (UNEVEN_HZ, 0.9),  # whose least distance is c/2 / 0.75 m
    ],
)
def test_it_is_where_a_point_is(tones_hz, z_m):
    """To a range cell, far less than tones leave open."""
    capture = exact_capture((0.01, -0.01, z_m), tones_hz)
    assert first_depth_m(capture) == pytest.approx(z_m, abs=0.015)


@pytest.mark.parametrize("tones_hz", [BESIDE_HZ, UNEVEN_HZ])
def test_a_method_begins_there(tones_hz):
    """The point at 0.85 m is more than 375 mm from the paper's first depth, so that 3-FSK takes it
    for one a period away."""
    capture, pixels = exact_capture((0.0, 0.0, 0.85), tones_hz), around((0, 0), 0.03, 0.002)
    fixed, begun = (depth_by("3fsk", capture, pixels, first_depth_m=z) for z in (0.45, "auto"))
    assert begun.z_m[15, 15] == pytest.approx(0.85, abs=1e-3)
    assert abs(fixed.z_m[15, 15] - 0.85) > 0.5
    assert begun.config["first_depth_m"] == pytest.approx(0.85, abs=0.015)


COARSE_HZ = 24e9 + 0.5e9 * np.arange(9)  # phases repeat every 0.3 m
COARSE = {"tones_hz": COARSE_HZ[[8, 7]].tolist(), "first_depth_m": "auto", "tolerance": None}
PLACES_M = np.mgrid[-0.1:0.1:21j, -0.1:0.1:21j, 0:1].reshape(3, -1).T


def test_coarse_tones_begin_where_the_plane_is_sharpest():
    """To a range cell, 37 mm."""
    scan = AntennaPairs(PLACES_M, PLACES_M)
    capture = exact_capture((0.02, 0.01, 0.47), COARSE_HZ, array=scan)
    depth = depth_by("2fsk", capture, around((0.02, 0.01), 0.1, 0.01), **COARSE)
    assert depth.config["first_depth_m"] == pytest.approx(0.47, abs=0.037)


def test_a_mirror_whose_planes_are_equally_sharp_is_asked_about():
    """One parallel to a scan at 0.4 m: all echoes are equal."""
    echo = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_S * COARSE_HZ * 0.8)
    samples = np.repeat(echo[None, :, None], len(PLACES_M), axis=2)
    capture = RadarCapture(samples, COARSE_HZ, AntennaPairs(PLACES_M, PLACES_M))
    refuse(lambda: depth_by("2fsk", capture, around((0, 0), 0.1, 0.01), **COARSE), "0.3 m")


@pytest.mark.parametrize(("count", "place"), [(64, "noise"), (3, "3 tones")])
def test_noise_and_few_tones_have_no_first_depth(count, place):
    capture = RadarCapture(noise((1, count, 94, 94)), SWEEP_HZ[:count], qar50())
    refuse(lambda: first_depth_m(capture), place)


@pytest.mark.parametrize("count", [22, 75, 127])
def test_a_scan_whose_paths_are_whole_steps_has_a_first_depth(count):
    """Transmitter and receiver share a place, so that all paths are multiples of the profile's
    step, and rounding decides in which step the last one is."""
    places_m = np.stack([*np.meshgrid(*[np.linspace(-0.05, 0.05, 6)] * 2), np.zeros((6, 6))], -1)
    scan = AntennaPairs(*[places_m.reshape(-1, 3)] * 2)
    capture = exact_capture((0, 0, 0.4), 60e9 + 25e6 * np.arange(count), array=scan)
    assert abs(first_depth_m(capture) - 0.4) < range_cell_m(capture.frequencies_hz) / 2
