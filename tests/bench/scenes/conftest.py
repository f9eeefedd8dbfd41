"""A ball of skin before the board, small enough to be photographed in a fraction of a second."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from handbench.bench.scenes.bodies import PhotoBody
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.light import Light, bake
from handbench.bench.scenes.photographs import Studio
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.stand import plate_print
from handbench.support.config import parse


def ball_scene(**photos: object) -> Scene:
    photos = {"cameras": 3, "width": 150, "height": 100} | photos
    values = {"version": 1, "name": "ball", "seed": 5, "photos": photos}
    return build(parse(SceneFile, values | {"target": {"kind": "sphere", "edge_m": 2e-3}}, "test"))


@pytest.fixture(scope="session")
def ball() -> Callable[..., Studio]:
    """Makes a studio with the ball from the keys of [photos]; `ball.scene` makes the scene alone.
    The lamps' light and the plate's print, the same for all, are made once."""
    baked: dict[int, Light] = {}
    printed = cache(plate_print)

    def remembered(rays: object, body: PhotoBody) -> Light:
        if len(body.faces) not in baked:
            baked[len(body.faces)] = bake(rays, body)
        return baked[len(body.faces)]

    def make(**photos: object) -> Studio:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("handbench.bench.scenes.photographs.bake", remembered)
            patch.setattr("handbench.bench.scenes.bodies.plate_print", printed)
            return Studio(ball_scene(**photos))

    make.scene = ball_scene
    return make
