"""The table of methods: named settings of a few functions."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.registry import METHODS, PAPER, method
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.simulated_points import around, depth_by
from tests.refusals import refuse

PAPERS = ["2fsk", "3fsk", "broadband", "narrowband"]
# what the embedded benchmark's radar measures, and 82 GHz again for velocities
TONES_HZ = np.append(np.unique([*np.linspace(72e9, 82e9, 128), 81.8e9, 79.5e9]), 82e9)


@pytest.fixture(scope="module")
def capture() -> RadarCapture:
    samples = simulate(Scatterers(np.array([[0.0, 0.0, 0.29]]), np.ones(1)), TONES_HZ, qar50())
    times_s = 1e-3 * np.arange(len(TONES_HZ))
    return RadarCapture(samples[None], TONES_HZ, qar50(), times_s=times_s)


@pytest.mark.parametrize("id", METHODS)
def test_every_method_finds_the_point_with_measured_tones_and_says_its_name(capture, id):
    depth = depth_by(id, capture, around((0, 0), half_m=0.006))
    assert depth.method == id
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


@pytest.mark.parametrize(
    ("id", "values", "place"),
    [
        ("nfsk", {"tones_hz": [82e9, 79.5e9, 81.8e9]}, "'tones_hz'"),
        ("nfsk", {"tones_hz": [82e9, 82e9, 72e9]}, "'tones_hz'"),
        ("broadband-aligned", {"tones_hz": {"count": 2}}, "3 or more tones"),
        ("joint", {"tones_hz": [82e9, 81e9, 81e9]}, "'tones_hz'"),
        ("joint", {"tones_hz": [82e9, 80e9, 79e9]}, "'tones_hz'"),
    ],
)
def test_tones_that_a_method_cannot_use_are_refused(id, values, place):
    refuse(lambda: method(id).configure(values, "config"), "config: ", place)
