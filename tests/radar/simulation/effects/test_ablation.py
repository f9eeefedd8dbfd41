"""What leaving an effect out changes in a coarse simulation, against two whole simulations."""

import numpy as np
import pytest

from handbench.radar.methods.fsk import Fsk, fsk
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.small_scenes import bead_scene, explained, simulated


@pytest.mark.parametrize(
    ("caused", "without", "rel"),
    [
        ({}, "obliquity", 0.2),
        ({"pattern": {"beamwidth_deg": 60.0}}, "pattern", 0.2),
        ({"noise": {"phase_noise_rad": 0.02}}, "noise", 0.4),
        ({"oscillator": {"level_dbc_hz": -70.0}}, "oscillator", 0.4),
        ({"roughness": {"rms_m": 3e-5}}, "roughness", 0.5),
    ],
)
def test_a_change_is_that_of_whole_simulations(caused, without, rel):
    """With the very numbers of the simulation's first frame, and 3-FSK as users run it."""
    scene, names = bead_scene(caused), {"obliquity", without}
    row = explained(scene, *names)[without]
    whole, rest = (simulated(scene, *effects).capture for effects in (names, names - {without}))
    level_db = 20 * np.log10(relative_error(rest.samples, whole.samples))
    assert row.level_db == pytest.approx(level_db, abs=0.5)
    maps_m = [fsk(capture, Fsk(first_depth_m=0.3))[0].z_m for capture in (whole, rest)]
    moved_mm = 1e3 * np.nanmean(np.abs(maps_m[1] - maps_m[0]))
    assert row.depth_mm == pytest.approx(moved_mm, rel=rel)
    assert row.seconds >= 0
