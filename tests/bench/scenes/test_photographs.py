"""Photographs: geometry against the true cameras, and the sensor's noise."""

import cv2
import numpy as np
import pytest

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.photographs import Studio, ray_directions
from handbench.bench.scenes.scene_file import Photos, SceneFile
from handbench.bench.scenes.stand import stand_board
from handbench.support.config import parse


@pytest.fixture(scope="module")
def scene() -> Scene:
    photos = {"cameras": 2, "width": 900, "height": 600}
    target = {"kind": "sphere", "edge_m": 4e-3}
    values = {"version": 1, "name": "t", "seed": 5, "photos": photos, "target": target}
    return build(parse(SceneFile, values, "test"))


@pytest.fixture(scope="module")
def studio(scene: Scene) -> Studio:
    return Studio(scene)


def test_markers_are_where_the_true_camera_projects_them(scene: Scene, studio: Studio) -> None:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(stand_board().cv_dictionary(), parameters)
    light = 255 * cv2.GaussianBlur(studio.expose(scene.cameras[0]), (0, 0), 0.5)
    corners, ids, _ = detector.detectMarkers(np.clip(light, 0, 255).astype(np.uint8))
    assert len(ids) >= 10
    places_m = stand_board().corners_m()
    places = [scene.cameras[0].project(places_m[int(number)]) for number in ids.ravel()]
    error = np.concatenate(corners) + 0.5 - places  # OpenCV's first pixel lies at 0, ours at 0.5
    # OpenCV draws the corners of a blurred marker 0.15 to 0.3 px inwards, evenly: its centre stays.
    # Medians, since the sphere may hide some corners.
    assert np.median(np.linalg.norm(error, axis=2)) < 0.35
    assert np.median(np.linalg.norm(error.mean(axis=1), axis=1)) < 0.06
    assert np.abs(np.median(error, axis=(0, 1))).max() < 0.05


def test_rays_undo_the_projection(scene: Scene) -> None:
    """Our iteration leaves 1e-6 px."""
    lens = (300.0, 310.0, 61.0, 39.0, -0.25, 0.09, 1e-3, -1e-3)
    changes = {"width": 120, "height": 80, "model": "OPENCV", "params": lens}
    camera = scene.cameras[0].model_copy(update=changes)
    pixels = np.mgrid[:120, :80].reshape(2, -1).T + 0.5
    rays = ray_directions(camera, pixels)
    seen = camera.project(camera.centre_m + 0.7 * rays)
    np.testing.assert_allclose(seen, pixels, atol=1e-6)


def test_the_mask_of_a_body_holds_all_pixels_that_show_it(scene: Scene, studio: Studio) -> None:
    """And not the whole picture, of which the sphere covers a twentieth."""
    camera = scene.cameras[0]
    pixels = np.moveaxis(np.mgrid[:600:4, :900:4], 0, -1)
    centres = pixels[..., ::-1].astype(np.float32) + 0.5
    _, depth_m = studio.shoot(camera, centres, np.ones(centres.shape[:2], dtype=bool))
    row, column = pixels[depth_m > 1].T  # of a body, see `shoot`
    near = np.any([body.near(camera) for body in studio.bodies], axis=0)
    assert len(row) > 500 and near[row, column].all() and near.mean() < 0.6


def test_noise_has_the_stated_level(scene: Scene, studio: Studio) -> None:
    """sRGB 128 is 0.216 of white; there the tone's slope is 255 · 1.055 / 2.4 · 0.216^(1/2.4 - 1) =
    255 · 1.075. Photon noise is sqrt(0.216 / 2000)."""
    part = scene.cameras[0].model_copy(update={"width": 400, "height": 300})
    photographs = []
    for electrons in (1e9, 2000.0):
        studio.photos = Photos(read_noise_e=0.0, blur_px=0.0, full_well_e=electrons)
        photographs.append(studio.photograph(part, 0).astype(float))
    clean, noisy = photographs
    grey = (np.abs(clean - 128) < 3).all(axis=2)
    assert grey.sum() > 500
    expected = 255 * 1.075 * np.sqrt(0.216 / 2000)
    assert (noisy - clean)[grey].std() == pytest.approx(expected, rel=0.1)
