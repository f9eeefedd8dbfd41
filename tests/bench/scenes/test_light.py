"""Highlights and speckle: physics of the lobe, what moves with the camera and what does not, the
projector's shadow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from handbench.bench.scenes.light import SKIN_REFLECTANCE, Projector, ggx, mirrored
from handbench.bench.scenes.photographs import Studio
from handbench.support.errors import HandbenchError

Ball = Callable[..., Studio]


def test_highlight_is_brightest_where_the_normal_halves_light_and_eye() -> None:
    turn = np.radians(np.linspace(-80, 80, 161))
    angles = turn, np.radians(50), np.radians(10)
    normals, light, eye = (np.stack([np.sin(a), 0 * a, np.cos(a)], axis=-1) for a in angles)
    same = (np.zeros((161, 3)), normals, np.tile(eye, (161, 1)), light[None], 1.0)
    shine = mirrored(*same, 0.1)
    assert np.degrees(turn[shine.argmax()]) == pytest.approx(30, abs=1)
    assert (shine[normals @ light <= 0] == 0).all()
    assert mirrored(*same, 0.3).max() < shine.max() / 5  # rougher: wider and weaker


def test_a_rough_mirror_keeps_nearly_all_light() -> None:
    """Light from above, the eye at each angle; single scattering loses a little."""
    angle, step = np.linspace(0, np.pi / 2, 2000, retstep=True)
    half, eye = np.cos(angle / 2), np.maximum(np.cos(angle), 1e-6)
    brdf = np.array([ggx(h, 1.0, e, h, 0.1, 1.0) for h, e in zip(half, eye, strict=True)])
    assert 0.97 < (brdf * eye * 2 * np.pi * np.sin(angle)).sum() * step <= 1


def test_fresnel_and_reciprocity() -> None:
    skin, mirror = (ggx(1.0, 0.5, 0.5, 0.5, 0.3, f) for f in (SKIN_REFLECTANCE, 1.0))
    assert skin / mirror == pytest.approx(SKIN_REFLECTANCE + (1 - SKIN_REFLECTANCE) / 32)
    assert ggx(0.9, 0.4, 0.7, 0.8, 0.3, 0.03) == pytest.approx(ggx(0.9, 0.7, 0.4, 0.8, 0.3, 0.03))


def test_dots_are_fixed_in_direction_and_have_their_size() -> None:
    projector = Projector(np.array([0.0, 0.2, 0.4]), np.zeros(3), 0.5, 2e-3, 3)
    across_m, along_m = np.meshgrid(*(np.linspace(-0.1, 0.1, n) for n in (21, 4001)), indexing="ij")
    screen_m = across_m[..., None] * projector.right + along_m[..., None] * projector.down
    picture, nearer = (
        projector.pattern((k * screen_m + (1 - k) * projector.position_m).reshape(-1, 3))
        for k in (1, 0.3)
    )
    assert picture == pytest.approx(nearer, abs=1e-4)
    assert picture.mean() == pytest.approx(0.5, abs=0.02)
    borders = np.count_nonzero(np.diff(picture.reshape(21, -1) > 0.5, axis=1))
    assert 21 * 0.2 / borders == pytest.approx(2e-3, rel=0.07)


def test_target_throws_a_shadow_in_the_projectors_light(ball: Ball) -> None:
    studio = ball(speckle=1.0)  # a dark room
    ray = studio.aim_m - studio.projector.position_m
    behind_m = studio.projector.position_m + ray * (studio.projector.position_m[2] / -ray[2])
    plate = np.array([behind_m, behind_m + [0.08, 0.0, 0.0]])
    beam = studio.projector.beam(studio.rays, plate, np.tile([0.0, 0.0, 1.0], (2, 1)), even=True)
    assert beam[0] == 0 < beam[1]


def test_a_projector_inside_the_target_is_refused(ball: Ball) -> None:
    with pytest.raises(HandbenchError, match="speckle_from_m: is 10 mm"):
        ball(speckle=0.5, speckle_from_m=[0.0, 0.0, 0.29])
