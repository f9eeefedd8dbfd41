"""Photographs: geometry against the true cameras, repeatability, the sensor's exposure and noise,
textures."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.hand_pose import POSES
from handbench.bench.scenes.photographs import (
    EXPOSURE,
    WHITE_BALANCE,
    Studio,
    develop,
    exposure,
    generator,
    white_balance,
)
from handbench.bench.scenes.scene_file import Photos, SceneFile
from handbench.bench.scenes.textures import Skin, cells, foam, skin, solid_noise
from handbench.support.config import parse

QUIET = {"full_well_e": 1e12, "read_noise_e": 0.0}


def linear(image: np.ndarray) -> np.ndarray:
    """An sRGB photograph made proportional to the light again, 1 at white: sRGB's own curve moves
    blurred edges into the dark."""
    value = image / 255
    return np.where(value < 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def make_scene(seed: int = 5, **photos: float) -> Scene:
    return build(
        parse(
            SceneFile,
            {
                "version": 1,
                "name": "t",
                "seed": seed,
                "target": {"kind": "calibration_target"},
                "photos": {"cameras": 2, "width": 1200, "height": 800} | photos,
            },
            "test",
        )
    )


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio(make_scene())


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


@pytest.fixture(scope="module")
def image(studio: Studio, scene: Scene) -> np.ndarray:
    return studio.photograph(scene.cameras[0], 0)


def test_markers_are_where_the_true_camera_projects_them(scene: Scene, image: np.ndarray) -> None:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    light = np.round(255 * linear(image)).astype(np.uint8)
    found, ids, _ = cv2.aruco.ArucoDetector(scene.board.cv_dictionary(), parameters).detectMarkers(
        light
    )
    assert len(ids) >= 10
    corners_m = scene.board.corners_m()
    error = np.stack(
        [  # OpenCV's first pixel lies at 0, ours at 0.5
            corners[0] + 0.5 - scene.cameras[0].project(corners_m[int(number)])
            for corners, number in zip(found, ids.ravel(), strict=True)
        ]
    )
    # OpenCV draws the corners of a blurred marker 0.15 to 0.3 px inwards, evenly: its centre stays.
    # Medians, since spheres hide some corners.
    assert np.median(np.linalg.norm(error, axis=2)) < 0.35
    assert np.median(np.linalg.norm(error.mean(axis=1), axis=1)) < 0.06
    assert np.abs(np.median(error, axis=(0, 1))).max() < 0.05


def test_spheres_are_where_the_true_camera_projects_them(studio: Studio, scene: Scene) -> None:
    camera = scene.cameras[1]
    centres_m = scene.radar_from_photo.inverse().points(scene.balls_m)
    directions = camera.ray_directions()
    _, depth, label = studio.shoot(camera.centre_m, directions)
    for centre_m, element, pixel in zip(
        centres_m, scene.target.element, camera.project(centres_m), strict=True
    ):
        column, row = np.floor(pixel).astype(int)
        assert label[row, column] == 0
        expected_m = np.linalg.norm(centre_m - camera.centre_m) - element.sphere_radius_m
        # Half a pixel off the centre's ray costs a micrometre; facets are flat to 0.01 mm.
        assert depth[row, column] == pytest.approx(expected_m, abs=2e-5)


def test_same_seed_same_photograph(image: np.ndarray, scene: Scene) -> None:
    again = Studio(make_scene())
    assert np.array_equal(again.photograph(scene.cameras[0], 0), image)
    assert not np.array_equal(
        again.photograph(scene.cameras[0], 1), image
    )  # another camera, other noise


def test_effects_are_off_unless_told(ball: Callable[..., Studio]) -> None:
    off = {
        "highlights": 0.0,
        "exposure_spread": 0.0,
        "white_balance_spread": 0.0,
        "motion_px": 0.0,
        "speckle": 0.0,
        "speckle_on_board": True,
        "roughness": 0.2,
        "focus_m": 0.1,  # nothing is left for these to change
    }
    camera = ball.scene().cameras[0]
    plain = ball().photograph(camera, 0)
    assert np.array_equal(ball(**off).photograph(camera, 0), plain)
    for effect in (
        {"highlights": 1.0},
        {"f_number": 4.0},
        {"exposure_spread": 0.3},
        {"white_balance_spread": 0.2},
        {"motion_px": 2.0},
        {"speckle": 0.5},
    ):
        studio = ball(**effect)
        image = studio.photograph(camera, 0)
        assert (image != plain).mean() > 0.02, effect
        assert np.array_equal(studio.photograph(camera, 0), image)


def test_noise_has_the_stated_level() -> None:
    quiet = {"width": 600, "height": 400, "read_noise_e": 0.0, "blur_px": 0.0}
    clean, noisy = (make_scene(full_well_e=electrons, **quiet) for electrons in (1e9, 2000.0))
    first = Studio(clean).photograph(clean.cameras[0], 0).astype(float)
    second = Studio(noisy).photograph(noisy.cameras[0], 0).astype(float)
    grey = (np.abs(first - 128) < 3).all(
        axis=2
    )  # sRGB 128 is 0.216 of white; there the tone's slope is 255 · 0.87
    spread = (second - first)[grey].std()
    # Slope of sRGB at 0.216: 1.055 / 2.4 · 0.216^(1/2.4 - 1) = 1.075; photon noise sqrt(0.216 /
    # 2000).
    assert spread == pytest.approx(255 * 1.075 * np.sqrt(0.216 / 2000), rel=0.1)


def test_exposure_uses_the_range(image: np.ndarray) -> None:
    assert np.percentile(image, 99) > 200
    assert (image == 255).all(axis=2).mean() < 0.01


def test_an_exposure_scales_the_light() -> None:
    radiance = np.broadcast_to(
        np.linspace(0.05, 0.3, 40, dtype=np.float32)[None, :, None], (2, 40, 3)
    )
    for number in range(3):
        image = linear(develop(radiance, Photos(exposure_spread=0.5, **QUIET), 7, number))
        gain = exposure(0.5, generator(7, EXPOSURE, number))
        assert image == pytest.approx(gain * radiance, rel=0.03)


def test_spreads_are_standard_deviations_in_stops() -> None:
    stops = [np.log2(exposure(0.3, generator(1, EXPOSURE, number))) for number in range(2000)]
    assert np.std(stops) == pytest.approx(0.3, rel=0.05) and abs(np.mean(stops)) < 0.03
    gains = np.log2(
        [white_balance(0.2, generator(1, WHITE_BALANCE, number)) for number in range(2000)]
    )
    assert np.std(gains[:, [0, 2]] - gains[:, 1:2], axis=0) == pytest.approx([0.2, 0.2], rel=0.06)
    assert exposure(0.0, generator(1, EXPOSURE, 0)) == 1


def test_what_is_clipped_is_white() -> None:
    image = develop(np.full((2, 2, 3), 5.0, np.float32), Photos(white_balance_spread=0.5), 3, 0)
    assert (image == 255).all()
    assert white_balance(0.5, generator(3, WHITE_BALANCE, 0)).min() == 1


def test_noise_does_not_depend_on_the_exposure() -> None:
    dark, noisy = np.zeros((20, 20, 3), np.float32), {"full_well_e": 100.0, "read_noise_e": 20.0}
    plain = develop(dark, Photos(**noisy), 3, 1)
    assert plain.std() > 10
    assert np.array_equal(develop(dark, Photos(exposure_spread=1.0, **noisy), 3, 1), plain)


def test_textures_belong_to_the_point() -> None:
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (400, 3))
    for texture in (lambda p: skin(p, 1.0, 3), lambda p: foam(p, 1.0, 3), Skin(POSES["U"], 1.0, 3)):
        whole = texture(points)
        assert whole.shape == (400, 3) and (whole > 0).all() and (whole < 1).all()
        assert np.array_equal(texture(points[100:140]), whole[100:140])


def test_skin_is_low_in_contrast() -> None:
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (20_000, 3))
    tone = skin(points, 1.0, 0).mean(axis=1)
    assert 0.02 < tone.std() / tone.mean() < 0.12
    assert skin(points, 0.0, 0).mean(axis=1).std() < 0.02 < tone.std() / tone.mean()


def test_solid_noise_is_smooth_seeded_and_balanced() -> None:
    points = np.random.default_rng(2).uniform(-0.05, 0.05, (20_000, 3))
    noise = solid_noise(points, 3e-3, 7)
    assert abs(noise.mean()) < 0.02 and 0.15 < noise.std() < 0.6 and np.abs(noise).max() < 2
    assert np.abs(solid_noise(points + 1e-6, 3e-3, 7) - noise).max() < 5e-3
    assert abs(np.corrcoef(noise, solid_noise(points, 3e-3, 8))[0, 1]) < 0.05


def test_cells_keep_their_size() -> None:
    points = np.random.default_rng(3).uniform(-0.02, 0.02, (20_000, 3))
    seam, tone = cells(points, 2e-3, 1)
    assert (seam >= 0).all() and 1e-4 < seam.mean() < 5e-4
    assert np.abs(tone).max() <= 1
