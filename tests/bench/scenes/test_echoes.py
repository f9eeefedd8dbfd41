"""Echoes of scenes: bodies, balls, room and causes reach the radar as the scene file says."""

import dataclasses

import numpy as np
import pytest

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.bench.scenes.visible import visible_surface

TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9]}


def scene(folder, surface, **changes):
    write_mesh(folder / "body.ply", surface)
    target = {"kind": "mesh", "path": "body.ply", "distance_m": 0.3}
    values = {"version": 1, "name": "s", "seed": 5, "target": target, "sensor": TONES, **changes}
    return build(parse(SceneFile, values, "test"), folder)


def ball(radius_m=0.02, z_m=0.0, resolution=40):
    return (
        load_open3d()
        .geometry.TriangleMesh.create_sphere(radius_m, resolution)
        .translate((0, 0, z_m))
    )


def test_only_the_near_side_of_a_ball_is_seen(tmp_path):
    surface = visible_surface(scene(tmp_path, ball()))
    # From a distance R one sees the cap of height a(1 − a/R) of a sphere: area 2πa²(1 − a/R), here
    # 0.00235 m².
    assert surface.weight.sum() == pytest.approx(2 * np.pi * 0.02**2 * (1 - 0.02 / 0.3), rel=0.02)
    assert (surface.position_m[:, 2] < 0.30).all()
    assert np.linalg.norm(surface.normal, axis=1) == pytest.approx(1)


def test_what_stands_behind_is_in_the_shadow(tmp_path):
    both = visible_surface(scene(tmp_path, ball() + ball(0.015, 0.05)))
    alone = visible_surface(scene(tmp_path, ball()))
    assert both.weight.sum() == pytest.approx(alone.weight.sum(), rel=1e-6)


def test_frames_differ_in_their_noise_alone(tmp_path):
    listed = {
        "effects": ["obliquity", "shadow_centre", "noise"],
        "noise": {"phase_noise_rad": 0.03},
    }
    noisy = echoes(scene(tmp_path, ball(), **listed), frames=3).capture.samples
    clean = echoes(
        scene(tmp_path, ball(), effects=["obliquity", "shadow_centre"]), frames=3
    ).capture.samples
    assert np.array_equal(clean[0], clean[2])
    deviation = noisy - clean
    assert not np.array_equal(deviation[0], deviation[1])
    level = np.sqrt(np.mean(np.abs(deviation) ** 2, axis=(2, 3)))
    assert level == pytest.approx(level.mean(), rel=0.05)  # 8836 draws each: 0.5 % (1σ)
    again = echoes(scene(tmp_path, ball(), **listed), frames=2).capture.samples
    assert np.array_equal(again, noisy[:2])  # a frame does not depend on how many there are


def test_coarse_meshes_are_split_until_they_sample_the_wavelength(tmp_path):
    surface = visible_surface(scene(tmp_path, ball(resolution=10)))
    # A quarter of the wavelength bounds the edges, and with them the facets' area: √3/4 · (0.915
    # mm)².
    assert surface.weight.max() < np.sqrt(3) / 4 * 0.000915**2 * 1.01
    fine = {"sweep": [], "tones_hz": [30e12]}
    with pytest.raises(HandbenchError, match="remesh"):
        visible_surface(scene(tmp_path, ball(0.02), sensor=fine))


def test_a_mesh_turned_inside_out_is_refused(tmp_path):
    inside_out = ball()
    inside_out.triangles = load_open3d().utility.Vector3iVector(
        np.asarray(inside_out.triangles)[:, ::-1].copy()
    )
    with pytest.raises(HandbenchError, match="no facet faces the array"):
        echoes(scene(tmp_path, inside_out, effects=["obliquity", "shadow_centre"]))


def test_tones_are_measured_in_the_order_of_the_file(tmp_path):
    sweep = [{"start_hz": 72e9, "stop_hz": 74e9, "count": 3}]
    sensor = {"sweep": sweep, "tones_hz": [82e9, 73e9, 81.8e9], "step_time_s": 2e-3}
    found = echo_scene(scene(tmp_path, ball(), sensor=sensor))
    assert found.frequencies_hz == pytest.approx([72e9, 73e9, 74e9, 81.8e9, 82e9])
    assert found.time_s == pytest.approx(
        [0, 2e-3, 4e-3, 10e-3, 6e-3]
    )  # 73 GHz: the first time that it is measured


def test_the_stand_is_seen_where_it_reflects(tmp_path):
    assert echo_scene(scene(tmp_path, ball())).room == ()
    seen = scene(
        tmp_path, ball(), stand={"reflectivity_db": -20.0, "empty": True}, effects=["clutter"]
    )
    [plate] = echo_scene(seen).room
    assert np.linalg.norm(plate.vertices_m[:, :2].max(axis=0) - [0.2, 0.15]) < 0.02
    assert plate.vertices_m[:, 2].min() > 0.37
    simulated = echoes(seen)
    assert np.abs(simulated.empty.samples).max() > 0
    subtracted = seen.file.model_copy(
        update={"stand": seen.file.stand.model_copy(update={"subtract": True})}
    )
    bare = echoes(dataclasses.replace(seen, file=subtracted)).capture.samples
    assert np.array_equal(bare, simulated.capture.samples - simulated.empty.samples[0])


def test_the_calibration_targets_balls_sit_in_foam():
    file = parse(
        SceneFile, {"version": 1, "name": "t", "target": {"kind": "calibration_target"}}, "test"
    )
    found = echo_scene(build(file))
    assert found.target is None and len(found.balls) == 5
    assert found.balls[0].radius_m == 0.005 and found.balls[0].foam_radius_m == 0.025


def test_palms_are_palmar_and_backs_are_not():
    target = {"kind": "hand", "pose": "B", "edge_m": 4e-3, "material": {"kind": "skin"}}
    body = echo_scene(
        build(parse(SceneFile, {"version": 1, "name": "b", "target": target}, "test"))
    ).target
    triangles = body.vertices_m[body.faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    not_forearm = (
        triangles[:, 0, 1] > -0.06
    )  # the palm's centre is at y = -0.03; B lays the thumb's back on the palm
    towards = (normal[:, 2] < -0.7 * np.linalg.norm(normal, axis=1)) & not_forearm
    away = (normal[:, 2] > 0.7 * np.linalg.norm(normal, axis=1)) & not_forearm
    assert body.material.kind == "skin"
    assert body.palm[towards].mean() > 0.85 and body.palm[away].mean() < 0.05
    assert not body.palm[triangles[:, 0, 1] < -0.11].any()  # the forearm
