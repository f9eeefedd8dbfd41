"""Axes and numbers that no machine holds are refused as they are read."""

import pytest

from handbench.bench.benchmarks.benchmark_file import MethodEntry
from handbench.bench.scenes.scene_file import Photos, Sensor
from handbench.groundtruth.cameras.cameras import Camera
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.support.config import parse
from handbench.support.errors import HandbenchError


def axis(step_m: float, stop_m: float = 1.0, start_m: float = 0.0) -> dict[str, float]:
    return {"start_m": start_m, "stop_m": stop_m, "step_m": step_m}


LONG = {"start_hz": 72e9, "stop_hz": 82e9, "count": 12_000}
CAMERA = {"name": "a.png", "width": 8, "height": 8, "params": (1.0,)}


def test_coordinates_may_be_as_small_as_rounding_makes_them():
    assert parse(Camera, CAMERA | {"t": (-1.03e-32, 0.0, 1.0)}, "x.toml").t == (-1.03e-32, 0, 1)


@pytest.mark.parametrize(
    ("model", "values", "words"),
    [
        (Fsk, {"x": axis(1e-9)}, "step_m = 1e-09 makes 1e+09 points"),
        (Fsk, {"x": axis(5e-324)}, "'x.step_m' is 5e-324; expected 0 or a size from 1e-30"),
        (Fsk, {"x": axis(5e-4)}, "0.0005 makes 2001 points on this axis"),
        (Backprojection, {"x": axis(1e-3), "y": axis(1e-3), "z": axis(2e-3)}, "axes x, y, z make"),
        (Backprojection, {"tones_hz": {"start_hz": 1e300}}, "'tones_hz.start_hz' is 1e+300"),
        (Backprojection, {"tones_hz": {"count": 10**9}}, "'tones_hz.count' is 1000000000"),
        (Fsk, {"first_depth_m": 10**400}, "first_depth_m"),
        (Fsk, {"filter_px": 10**9 + 1}, "from 1 to 2000"),
        (Fsk, {"corrections": 10**9}, "'corrections' is 1000000000"),
        (MethodEntry, {"id": "2fsk", "config": {"x": {"start_m": 1e300}}}, "'config' is"),
        (MethodEntry, {"id": "2fsk", "every_nth_antenna": 10**30}, "less than or equal to 1000"),
        (MethodEntry, {"id": "a", "command": "a", "limit_s": 1e30}, "'limit_s' is 1e+30"),
        (Photos, {"blur_px": 1e9}, "'blur_px' is 1000000000.0"),
        (Sensor, {"sweep": [LONG, LONG]}, "make 24000 tones, more than 20000"),
        (Camera, CAMERA | {"R": ((1.0, 0, 0), (0, 1, 0), (0, 0, 1e300))}, "'R'"),
        (Camera, CAMERA | {"t": (0.0, 0.0, -1e300)}, "'t' is (0.0, 0.0, -1e+300)"),
    ],
)
def test_what_no_machine_holds_is_refused(model, values, words):
    with pytest.raises(HandbenchError) as refused:
        parse(model, values, "x.toml")
    assert words in str(refused.value) and str(refused.value).startswith("x.toml: ")
