"""Antenna pattern: half power at half the beamwidth, a factor of every channel."""

from itertools import pairwise

import numpy as np
import pytest

from handbench.radar.simulation.causes import Pattern
from handbench.radar.simulation.scene import Ball
from tests.radar.simulation.effects.small_scenes import bead_scene, effect, estimated, simulated


@pytest.mark.parametrize("beamwidth_deg", [10.0, 60.0, 150.0])
def test_power_is_halved_at_half_the_beamwidth(beamwidth_deg):
    exponent = Pattern(beamwidth_deg=beamwidth_deg).exponent
    assert np.cos(np.radians(beamwidth_deg) / 2) ** (2 * exponent) == pytest.approx(0.5, rel=1e-12)


def gains(array, point_m, beamwidth_deg):
    """cosᵠθ of both antennas of each channel [t, r] towards a point."""
    cosines = [
        (point_m - a)[:, 2] / np.linalg.norm(point_m - a, axis=1) for a in (array.tx_m, array.rx_m)
    ]
    return np.multiply.outer(*cosines) ** Pattern(beamwidth_deg=beamwidth_deg).exponent


def test_a_bead_is_weighed_by_both_antennas():
    scene = bead_scene({"pattern": {"beamwidth_deg": 60.0}})
    with_it, without = (
        simulated(scene, "obliquity", *more).capture.samples[0] for more in (("pattern",), ())
    )
    expected = without * gains(scene.array, np.array([0.01, -0.005, 0.3]), 60.0)
    # The bead's specular points lie up to 4 mm before its middle: 2q·tan θ·Δθ, at most
    # 2·2.4·0.33·0.004 = 1 %.
    assert np.linalg.norm(with_it - expected) < 0.01 * np.linalg.norm(expected)
    assert np.linalg.norm(with_it - without) > 0.1 * np.linalg.norm(without)


def test_balls_are_weighed_too():
    centre_m = np.array([0.05, 0.0, 0.3])
    scene = bead_scene(
        {"pattern": {"beamwidth_deg": 40.0}}, target=None, balls=(Ball(centre_m, 5e-3),)
    )
    with_it, without = (simulated(scene, *more).capture.samples[0] for more in (("pattern",), ()))
    expected = without * gains(scene.array, centre_m, 40.0)
    assert np.abs(with_it - expected).max() < 1e-6 * np.abs(without).max()  # float32


def test_the_estimate_grows_as_the_beam_narrows():
    widths_deg = (179.0, 120.0, 60.0, 30.0)
    scenes = [bead_scene({"pattern": {"beamwidth_deg": width_deg}}) for width_deg in widths_deg]
    found = [estimated(scene, "pattern", "obliquity", without="pattern") for scene in scenes]
    depths_mm = [changes["3fsk"].depth_mm for changes, _ in found]
    assert depths_mm[0] < 1e-3  # as good as none
    assert all(a < b for a, b in pairwise(depths_mm))
    assert found[-1][1] > -10  # half power at 15°, where half of the array is


def test_an_unknown_beamwidth_is_missing():
    assert effect("pattern").missing(bead_scene())
