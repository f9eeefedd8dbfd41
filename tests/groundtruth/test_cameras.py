"""Cameras in files there and back; their projection: test_metashape."""

import json

import numpy as np
import pytest

from handbench.groundtruth.cameras import Camera, load_cameras, save_cameras
from tests.refusals import refuse

TURNED = ((0.6, 0, 0.8), (0, 1, 0), (-0.8, 0, 0.6))
CAMERA = Camera(name="a", width=320, height=240, params=(300.0,) * 8, R=TURNED, t=(0.1, -0.2, 1.5))
BARE = Camera(name="b", width=640, height=480, model="PINHOLE", params=(500, 500, 320, 240))


def test_round_trip_through_a_file(tmp_path):
    save_cameras(tmp_path / "cameras.json", (CAMERA, BARE))
    assert load_cameras(tmp_path / "cameras.json") == (CAMERA, BARE)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"R": np.diag([1, 1, -1]).tolist()}, "cameras.0.R"),
        # digits of a file are worth 1e-6: a mesh 1 m away stays within a micrometre
        ({"R": np.diag([1, 1, 1 + 1e-6]).tolist()}, "cameras.0.R"),
        ({"model": "FISH"}, "'FISH' with 1"),
        ({"model": "OPENCV"}, "'OPENCV' with 1"),
    ],
)
def test_wrong_cameras_are_refused(tmp_path, change, place):
    camera = {"name": "a", "width": 1, "height": 1, "params": [1.0]} | change
    (tmp_path / "cameras.json").write_text(json.dumps({"cameras": [camera]}))
    refuse(lambda: load_cameras(tmp_path / "cameras.json")[0].colmap(), place)
