"""Antenna pattern: half power at half the beamwidth, a factor of every channel."""

from itertools import pairwise

import numpy as np
import pytest

from handbench.radar.simulation.scene import Ball
from tests.radar.simulation.effects.small_scenes import bead_scene, explained, simulated

BALL_M, BEAD_M = np.array([0.05, 0.0, 0.3]), np.array([0.01, -0.005, 0.3])


@pytest.mark.parametrize(
    ("at_m", "effects", "changes", "within"),
    [
        # The bead's specular points lie up to 4 mm before its middle: 2q·tan θ·Δθ, at most
        # 2·2.4·0.33·0.004 = 1 %.
        (BEAD_M, ("obliquity",), {}, 0.01),
        (BALL_M, (), {"target": None, "balls": (Ball(BALL_M, 5e-3),)}, 1e-5),
    ],
)
def test_echoes_are_weighed_by_both_antennas(at_m, effects, changes, within):
    """By cosᵠθ each, whose square is half at half the beamwidth."""
    scene = bead_scene({"pattern": {"beamwidth_deg": 60.0}}, **changes)
    weighed, plain = (
        simulated(scene, *effects, *more).capture.samples[0] for more in (("pattern",), ())
    )
    exponent = np.log(0.5) / (2 * np.log(np.cos(np.radians(30.0))))
    ways_m = [at_m - leg.position_m for leg in scene.array.legs]
    gains = [(way[:, 2] / np.linalg.norm(way, axis=1)) ** exponent for way in ways_m]
    expected = plain * np.multiply.outer(*gains)
    assert np.linalg.norm(weighed - expected) < within * np.linalg.norm(expected)
    assert np.linalg.norm(weighed - plain) > 0.1 * np.linalg.norm(plain)


def test_the_estimate_grows_as_the_beam_narrows():
    scenes = [bead_scene({"pattern": {"beamwidth_deg": deg}}) for deg in (179.0, 120.0, 60.0, 30.0)]
    rows = [explained(scene, "pattern", "obliquity")["pattern"] for scene in scenes]
    depths_mm = [row.depth_mm for row in rows]
    assert depths_mm[0] < 1e-3  # as good as none
    assert all(a < b for a, b in pairwise(depths_mm))
    assert rows[-1].level_db > -10  # half power at 15°, where half of the array is
