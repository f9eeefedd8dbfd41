"""Axes and numbers that no machine holds are refused as they are read."""

import pytest

from handbench.bench.benchmarks.benchmark_file import MethodEntry
from handbench.bench.scenes.scene_file import Sensor
from handbench.groundtruth.cameras import Camera
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.support.config import parse
from tests.refusals import refuse

X = {"start_m": 0.0, "stop_m": 1.0, "step_m": 1e-3}
LONG = {"start_hz": 72e9, "stop_hz": 82e9, "count": 12_000}
CAMERA = {"name": "a.png", "width": 8, "height": 8, "params": (1.0,)}


def test_coordinates_may_be_as_small_as_rounding_makes_them():
    assert parse(Camera, CAMERA | {"t": (-1.03e-32, 0.0, 1.0)}, "x.toml").t == (-1.03e-32, 0, 1)


@pytest.mark.parametrize(
    ("model", "values", "place"),
    [
        (Fsk, {"x": X | {"step_m": 5e-324}}, "'x.step_m'"),
        (Fsk, {"x": X | {"step_m": 5e-4}}, "2001 points"),
        (Fsk, {"x": X | {"step_m": 2.0}}, "step_m = 2"),
        (Fsk, {"x": X | {"stop_m": -1.0}}, "stop_m"),
        (Backprojection, {"x": X, "y": X, "z": X | {"step_m": 2e-3}}, "axes x, y, z"),
        (Backprojection, {"tones_hz": {"start_hz": 1e300}}, "'tones_hz.start_hz'"),
        (Fsk, {"first_depth_m": 10**400}, "first_depth_m"),
        (Fsk, {"filter_px": 2001}, "from 1 to 2000"),
        (Fsk, {"filter_px": 4}, "filter_px"),
        (MethodEntry, {"id": "2fsk", "config": {"x": {"start_m": 1e300}}}, "'config'"),
        (Sensor, {"sweep": [LONG, LONG]}, "24000 tones"),
        (Camera, CAMERA | {"t": (0.0, 0.0, -1e300)}, "'t'"),
    ],
)
def test_what_no_machine_holds_is_refused(model, values, place):
    refuse(lambda: parse(model, values, "x.toml"), "x.toml: ", place)
