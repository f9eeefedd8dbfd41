"""The table of methods: named settings of a few functions."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.registry import METHODS, PAPER, method
from handbench.radar.simulation.forward import Scatterers, simulate

PAPERS = ["2fsk", "3fsk", "broadband", "narrowband"]
PIXELS = {axis: {"start_m": -0.006, "stop_m": 0.006, "step_m": 0.001} for axis in "xy"}
SWEEP_HZ = np.unique(
    [*np.linspace(72e9, 82e9, 128), 81.8e9, 79.5e9]
)  # what the embedded benchmark's radar measures


@pytest.fixture(scope="module")
def capture() -> RadarCapture:
    point = Scatterers(np.array([[0.0, 0.0, 0.29]]), np.ones(1))
    hz = np.append(SWEEP_HZ, 82e9)  # again, for the methods that measure velocities
    samples = simulate(point, hz, qar50())[None]
    return RadarCapture(samples, hz, qar50(), times_s=1e-3 * np.arange(len(hz)))


@pytest.mark.parametrize("name", list(METHODS))
def test_every_method_finds_the_point_with_measured_tones_and_says_its_name(capture, name):
    depth = method(name).run(capture, method(name).configure(PIXELS, name), 0)
    assert depth.method == name
    # Without noise on the axis, voxels of 1 mm or better; narrowband's next lobe is 62 mm away,
    # outside its volume.
    assert abs(depth.z_m[6, 6] - 0.29) < 0.5e-3 + 1e-9


def test_the_papers_methods_come_first_and_change_nothing():
    assert list(METHODS)[:4] == PAPERS
    assert all((m.source == PAPER) == (m.id in PAPERS) for m in METHODS.values())
    assert METHODS["3fsk"].defaults == Fsk() and METHODS["broadband"].defaults == Backprojection()
    better = ("off_axis", "weighted", "drop_doubtful", "subvoxel")
    configs = [METHODS[id].defaults.model_dump() for id in PAPERS]
    assert not any(config.get(key) for key in better for config in configs)
