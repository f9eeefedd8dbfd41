"""Cameras: COLMAP's projection and its pixel convention, files there and back."""

import json

import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import Camera, load_cameras, save_cameras
from tests.refusals import refuse

FX, FY, CX, CY, K1, K2, P1, P2 = PARAMS = (300.0, 310.0, 161.0, 119.0, -0.05, 0.03, 1e-3, -2e-3)


@pytest.fixture
def camera():
    turn = np.deg2rad(20)
    R = ((np.cos(turn), 0, np.sin(turn)), (0, 1, 0), (-np.sin(turn), 0, np.cos(turn)))
    return Camera(name="a.jpg", width=320, height=240, params=PARAMS, R=R, t=(0.1, -0.2, 1.5))


def test_round_trip_through_a_file(camera, tmp_path):
    bare = Camera(name="b.jpg", width=640, height=480, model="PINHOLE", params=(500, 500, 320, 240))
    save_cameras(tmp_path / "cameras.json", (camera, bare))
    assert load_cameras(tmp_path / "cameras.json") == (camera, bare)


def test_projects_as_opencv_does_half_a_pixel_apart(camera):
    cv2 = pytest.importorskip("cv2")
    points_m = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    K = np.array([[FX, 0, CX - 0.5], [0, FY, CY - 0.5], [0, 0, 1]])
    expected, _ = cv2.projectPoints(
        points_m,
        cv2.Rodrigues(camera.rotation)[0],
        camera.translation_m,
        K,
        np.array([K1, K2, P1, P2]),
    )
    np.testing.assert_allclose(camera.project(points_m), expected.reshape(-1, 2) + 0.5, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"R": np.diag([1, 1, -1]).tolist()}, "cameras.0.R"),
        ({"model": "FISH"}, "'FISH' with 1"),
        ({"model": "OPENCV"}, "'OPENCV' with 1"),
    ],
)
def test_wrong_cameras_are_refused(tmp_path, change, place):
    camera = {"name": "a", "width": 1, "height": 1, "params": [1.0]} | change
    (tmp_path / "cameras.json").write_text(json.dumps({"cameras": [camera]}))
    refuse(lambda: load_cameras(tmp_path / "cameras.json")[0].colmap(), place)
