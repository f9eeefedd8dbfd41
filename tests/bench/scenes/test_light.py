"""Highlights and speckle: physics of the lobe, what moves with the camera and what does not, the
projector's shadow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from handbench.bench.scenes.light import SKIN_REFLECTANCE, Projector, ggx, mirrored
from handbench.bench.scenes.photographs import Studio
from handbench.bench.scenes.stand import MARKER_CENTRES_M
from handbench.support.errors import HandbenchError

Ball = Callable[..., Studio]


def seen_from(studio: Studio, point_m: np.ndarray, cameras: tuple) -> np.ndarray:
    """Radiance [camera, 3] of a surface point [3]."""
    towards = [point_m - camera.centre_m for camera in cameras]
    rays = [
        (camera.centre_m, ray / np.linalg.norm(ray))
        for camera, ray in zip(cameras, towards, strict=True)
    ]
    return np.array([studio.shoot(centre_m, ray[None])[0][0] for centre_m, ray in rays])


def front_m(studio: Studio) -> np.ndarray:
    """The ball's point [3] that faces the board's z, on its facets."""
    above_m, down = studio.aim_m + [0.0, 0.0, 0.1], np.array([0.0, 0.0, -1.0])
    return above_m + studio.shoot(above_m, down[None])[1][0] * down


def test_highlight_is_brightest_where_the_normal_halves_light_and_eye() -> None:
    turn = np.radians(np.linspace(-80, 80, 161))
    normals = np.stack([np.sin(turn), np.zeros(161), np.cos(turn)], axis=1)
    light, eye = (np.array([np.sin(a), 0.0, np.cos(a)]) for a in np.radians([50, 10]))
    same = (np.zeros((161, 3)), normals, np.tile(eye, (161, 1)), light[None], 1.0)
    shine = mirrored(*same, 0.1)
    assert np.degrees(turn[shine.argmax()]) == pytest.approx(30, abs=1)
    assert (shine[normals @ light <= 0] == 0).all()
    assert mirrored(*same, 0.3).max() < shine.max() / 5  # rougher: wider and weaker


def test_a_rough_mirror_keeps_nearly_all_light() -> None:
    angle, step = np.linspace(
        0, np.pi / 2, 2000, retstep=True
    )  # light from above, the eye at `angle`
    half, eye = np.cos(angle / 2), np.maximum(np.cos(angle), 1e-6)
    brdf = np.array([ggx(h, 1.0, e, h, 0.1, 1.0) for h, e in zip(half, eye, strict=True)])
    assert (
        0.97 < (brdf * eye * 2 * np.pi * np.sin(angle)).sum() * step <= 1
    )  # single scattering loses a little


def test_fresnel_and_reciprocity() -> None:
    assert ggx(1.0, 0.5, 0.5, 0.5, 0.3, SKIN_REFLECTANCE) / ggx(
        1.0, 0.5, 0.5, 0.5, 0.3, 1.0
    ) == pytest.approx(SKIN_REFLECTANCE + (1 - SKIN_REFLECTANCE) / 32)
    assert ggx(0.9, 0.4, 0.7, 0.8, 0.3, 0.03) == pytest.approx(ggx(0.9, 0.7, 0.4, 0.8, 0.3, 0.03))


def test_only_highlights_depend_on_the_camera(ball: Ball) -> None:
    cameras = ball.scene().cameras
    for photos, changes in (
        ({"speckle": 0.8}, False),
        ({"highlights": 3.0, "roughness": 0.15}, True),
    ):
        studio = ball(**photos)
        seen = seen_from(studio, front_m(studio), cameras)
        assert (np.ptp(seen, axis=0) > 0.02).all() == changes
        if not changes:
            assert seen[1:] == pytest.approx(np.tile(seen[0], (2, 1)), rel=0.01)


def test_highlights_add_light_to_skin_alone(ball: Ball) -> None:
    camera = ball.scene().cameras[0]
    directions = camera.ray_directions()
    (matt, _, label), (shiny, _, _) = (
        ball(highlights=h).shoot(camera.centre_m, directions) for h in (0.0, 2.0)
    )
    assert (shiny >= matt).all() and (shiny[label == 0] > matt[label == 0] + 1e-3).mean() > 0.3
    assert np.array_equal(shiny[label != 0], matt[label != 0])


def test_dots_are_fixed_in_direction_and_have_their_size() -> None:
    projector = Projector(np.array([0.0, 0.2, 0.4]), np.zeros(3), 0.5, 2e-3, 3)
    across_m, along_m = np.meshgrid(
        np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1, 4001), indexing="ij"
    )
    screen_m = across_m.reshape(-1, 1) * projector.right + along_m.reshape(-1, 1) * projector.down
    picture = projector.pattern(screen_m)
    assert picture == pytest.approx(
        projector.pattern(0.3 * screen_m + 0.7 * projector.position_m), abs=1e-4
    )
    assert (
        picture.min() >= 0 and picture.max() <= 1 and picture.mean() == pytest.approx(0.5, abs=0.02)
    )
    borders = np.count_nonzero(np.diff(picture.reshape(across_m.shape) > 0.5, axis=1))
    assert 21 * 0.2 / borders == pytest.approx(2e-3, rel=0.07)
    assert (projector.pattern(projector.position_m - 0.1 * projector.axis[None]) == 0).all()


def test_speckle_spares_the_board_unless_told(ball: Ball) -> None:
    centres_m = np.array([(x, y, 0.0) for x, y in MARKER_CENTRES_M])
    camera = ball.scene().cameras[0]
    offsets_m = np.random.default_rng(0).uniform(-0.015, 0.015, (20, 1, 3)) * [1, 1, 0]
    markers_m = (centres_m + offsets_m).reshape(-1, 3)
    rays = markers_m - camera.centre_m
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    plain, spared, dotted = (
        ball(**photos).shoot(camera.centre_m, rays)[0][:, 0]
        for photos in ({}, {"speckle": 0.5}, {"speckle": 0.5, "speckle_on_board": True})
    )
    per_marker = [(part / plain).reshape(20, -1).std(axis=0) for part in (spared, dotted)]
    assert np.median(per_marker[0]) < 0.02 < 0.2 < np.median(per_marker[1])


def test_target_throws_a_shadow_in_the_projectors_light(ball: Ball) -> None:
    studio = ball(speckle=1.0)  # a dark room
    ray = studio.aim_m - studio.projector.position_m
    behind_m = studio.projector.position_m + ray * (studio.projector.position_m[2] / -ray[2])
    plate = np.array([behind_m, behind_m + [0.08, 0.0, 0.0]])
    beam = studio.projector.beam(studio.rays, plate, np.tile([0.0, 0.0, 1.0], (2, 1)), even=True)
    assert beam[0] == 0 < beam[1]


def test_a_projector_inside_the_target_is_refused(ball: Ball) -> None:
    with pytest.raises(HandbenchError, match="speckle_from_m: lies 10 mm"):
        ball(speckle=0.5, speckle_from_m=[0.0, 0.0, 0.29])
