"""The second renderer: its cameras against COLMAP's projection, its bitmap against handbench's, and
its absence."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from handbench.bench.scenes.build import build
from handbench.bench.scenes.photographs import Studio
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.shapes import sphere_mesh
from handbench.bench.scenes.stand import rig
from handbench.calibration.transforms import identity
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.references.renderers.atlas import Atlas
from tests.references.renderers.measure_renderers import floating, pinhole, renderers
from tests.references.renderers.path_tracer import PathTracer, load_mitsuba, sensor


def ball_atlas():
    ball = sphere_mesh(0.01, 1e-3)
    return Atlas.of(np.asarray(ball.vertices), np.asarray(ball.triangles), 3)


def mitsuba_or_skip():
    try:
        return load_mitsuba()
    except HandbenchError as error:
        pytest.skip(str(error))


def test_without_mitsuba_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(HandbenchError, match=r"^mitsuba: is not installed; .*pip install mitsuba"):
        load_mitsuba()


def test_a_small_light_is_photographed_where_cameras_json_projects_it():
    """Centroid of a ball of 1 mm, whose own perspective is below 0.005 px, in each camera:
    principal point, pixel centres, axes. A shift of the pixel centres would be 0.5 px."""
    mi = mitsuba_or_skip()
    lamp = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    for number, camera in enumerate(
        map(pinhole, rig(3, 600, 400, np.array([0.0, 0.0, 0.3]), identity("radar"), seed=3))
    ):
        at_m = np.array([0.03, -0.02, 0.31]) * (1 - number, number - 1, 1)
        ball = {"type": "sphere", "center": at_m.tolist(), "radius": 1e-3, "emitter": lamp}
        scene = mi.load_dict({"type": "scene", "integrator": {"type": "path"}, "ball": ball})
        light = np.array(mi.render(scene, sensor=mi.load_dict(sensor(mi, camera, 64)), seed=1))[
            ..., 1
        ].astype(float)
        y, x = np.mgrid[: camera.height, : camera.width] + 0.5
        seen = np.array([(x * light).sum(), (y * light).sum()]) / light.sum()
        assert seen == pytest.approx(camera.project(at_m[None])[0], abs=0.04)


def test_the_bitmap_on_a_ball_is_the_texel_that_its_coordinates_name():
    """The reflectance at facets' middles, from the point only, against the bitmap at the mean
    of the corners' texels, rounded: equal up to the pattern's change over a texel; shuffled points
    are not."""
    atlas = ball_atlas()
    middle_m = atlas.vertices_m[atlas.faces].mean(axis=1)
    column, row = (atlas.corner_texels().mean(axis=1) - 0.5).round().astype(int).T
    off = np.abs(atlas.reflectance(middle_m) - atlas.bitmap[row, column]).max(axis=1)
    shuffled = np.abs(atlas.reflectance(middle_m[::-1]) - atlas.bitmap[row, column]).max(axis=1)
    assert np.median(off) < 0.3 * np.median(shuffled)


@pytest.mark.slow
def test_both_renderers_photograph_one_scene_without_a_block():
    first, second = renderers(("C",))
    assert first.scene_file() == second.scene_file().model_copy(
        update={"name": first.scene_file().name}
    )
    scene = floating(build(first.scene_file()))
    assert scene.block_m is None and all(camera.model == "PINHOLE" for camera in scene.cameras)
    in_photo_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    assert (in_photo_m >= scene.box_m[0]).all() and (in_photo_m <= scene.box_m[1]).all()


def _bands(picture):
    """Between 2 and 8 pixels: neither what a texel's sampling makes of fine grain, nor light."""
    return gaussian_filter(picture, 2) - gaussian_filter(picture, 8)


def test_both_renderers_show_the_same_surfaces_in_the_same_places():
    """Grey pictures of a ball before the board by both: light and noise differ, the prints do
    not."""
    mitsuba_or_skip()
    photos = {"cameras": 2, "width": 360, "height": 240}
    values = {
        "version": 1,
        "name": "ball",
        "target": {"kind": "sphere", "radius_m": 0.04},
        "photos": photos,
    }
    scene = floating(build(parse(SceneFile, values, "ball")))
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    atlas = Atlas.of(vertices_m, np.asarray(scene.target_mesh.triangles), 0)
    studio, camera = Studio(scene), scene.cameras[0]
    studio.bodies[0] = replace(studio.bodies[0], albedo=atlas.reflectance)
    pictures = (
        studio.photograph(camera, 0),
        PathTracer(scene, atlas, samples=16).photograph(camera, 0),
    )
    ours, theirs = (_bands(picture.mean(axis=-1)) for picture in pictures)
    column, row = camera.project(vertices_m).mean(axis=0).astype(int)
    for part in (
        np.s_[row - 25 : row + 25, column - 25 : column + 25],
        np.s_[:, : column - 80],
    ):  # the ball; the board
        here, moved = (
            np.corrcoef(a.ravel(), theirs[part].ravel())[0, 1]
            for a in (ours[part], np.roll(ours, 5)[part])
        )
        assert here > 0.75 and here > moved + 0.3
