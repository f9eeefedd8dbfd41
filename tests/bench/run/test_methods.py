"""The registered methods: presets of a few functions, each named after itself."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.fsk_config import SETTLING, LadderConfig, ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.radar.methods.registry import PAPER, method, methods
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError

PAPERS = ["2fsk", "3fsk", "broadband", "narrowband"]
PRESETS = {  # improved method: the one it starts from, and what it changes
    "2fsk-settled": ("2fsk", {"corrections": SETTLING}),
    "3fsk-settled": ("3fsk", {"corrections": SETTLING}),
    "3fsk-offaxis": ("3fsk", {"off_axis": True}),
    "3fsk-weighted": ("3fsk", {"weighted": True}),
    "3fsk-plus": (
        "3fsk",
        {"off_axis": True, "weighted": True, "fine_refinements": 2, "drop_wrapped": True},
    ),
    "nfsk-plus": (
        "nfsk",
        {"off_axis": True, "weighted": True, "fine_refinements": 2, "drop_wrapped": True},
    ),
    "broadband-subvoxel": ("broadband", {"subvoxel": True, "tolerance": 1e-4}),
}
SENSORS = ["kinect", "realsense", "zed"]
PIXELS = {axis: {"start_m": -0.006, "stop_m": 0.006, "step_m": 0.001} for axis in "xy"}
SWEEP_HZ = np.unique(
    [*np.linspace(72e9, 82e9, 128), 81.8e9, 79.5e9]
)  # what the embedded benchmark's radar measures


@pytest.fixture(scope="module")
def capture() -> RadarCapture:
    point = Scatterers(np.array([[0.0, 0.0, 0.29]]), np.ones(1))
    return RadarCapture(simulate(point, SWEEP_HZ, qar50())[None], SWEEP_HZ, qar50())


def test_the_papers_methods_come_first_and_change_nothing():
    assert [m.id for m in methods()][:4] == PAPERS
    assert all((m.source == PAPER) == (m.id in PAPERS) for m in methods())
    plain = {"3fsk": ThreeToneConfig(), "broadband": BroadbandConfig(), "nfsk": LadderConfig()}
    assert all(method(name).config() == config for name, config in plain.items())
    for name in PAPERS:
        config = method(name).config().model_dump()
        assert not any(
            config.get(key) for key in ("off_axis", "weighted", "drop_wrapped", "subvoxel")
        )


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_changes_what_it_says_and_nothing_else(name):
    base, changes = PRESETS[name]
    assert method(name).config().model_dump() == method(base).config().model_dump() | changes


def test_fsk_corrects_the_plane_once_unless_its_name_says_otherwise():
    once = {m.id: getattr(m.config(), "corrections", 1) == 1 for m in methods()}
    assert [id for id in once if not once[id]] == ["2fsk-settled", "3fsk-settled"]


@pytest.mark.parametrize("name", ["2fsk", "2fsk-settled", "3fsk-plus", "nfsk"])
def test_a_plane_that_is_never_corrected_is_refused(name):
    with pytest.raises(HandbenchError, match=r"corrections.*greater than or equal to 1"):
        method(name).configure({"corrections": 0}, name)


@pytest.mark.parametrize("name", SENSORS)
def test_another_sensor_is_asked_for_its_depth_alone(capture, name):
    def saw(grid, frame):
        return np.where(grid.points_m(0.0)[..., 0] < 0, 0.3 + 0.01 * frame, np.nan)

    config = method(name).configure(PIXELS, name)
    depth = method(name).run(replace(capture, sensors={name: saw}), config, 1).depth
    assert (
        depth.method == name and (np.isfinite(depth.z_m) == np.isfinite(depth.amplitude_db)).all()
    )
    np.testing.assert_array_equal(
        depth.z_m, np.where(np.arange(13) < 6, 0.31, np.nan) * np.ones((13, 1))
    )
    with pytest.raises(HandbenchError, match=f"{name}: the capture holds no depth of that sensor"):
        method(name).run(capture, config, 0)


@pytest.mark.parametrize("name", [m.id for m in methods() if m.id not in SENSORS])
def test_every_method_finds_the_point_with_measured_tones_and_says_its_name(capture, name):
    depth = method(name).run(capture, method(name).configure(PIXELS, name), 0).depth
    assert depth.method == name
    # Without noise on the axis, voxels of 1 mm or better; narrowband's next lobe is 62 mm away,
    # outside its volume.
    assert abs(depth.z_m[6, 6] - 0.29) < 0.5e-3 + 1e-9
