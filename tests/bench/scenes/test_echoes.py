"""Echoes of scenes: bodies, balls, room and causes reach the radar as the scene file says."""

import numpy as np
import pytest

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.mesh.mesh_files import load_open3d, mesh, write_mesh
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.bench.scenes.visible import visible_surface

TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9]}


def scene(folder, surface, **changes):
    write_mesh(folder / "body.ply", surface)
    target = {"kind": "mesh", "path": "body.ply", "distance_m": 0.3}
    return built({"seed": 5, "target": target, "sensor": TONES, **changes}, folder)


def ball(radius_m=0.02, z_m=0.0, resolution=40):
    whole = load_open3d().geometry.TriangleMesh.create_sphere(radius_m, resolution)
    return whole.translate((0, 0, z_m))


def test_frames_differ_in_their_noise_alone(tmp_path):
    effects = ["obliquity", "shadow"]
    clean = echoes(scene(tmp_path, ball(), effects=effects), frames=3).capture.samples
    noise = {"effects": [*effects, "noise"], "noise": {"phase_noise_rad": 0.03}}
    noisy_scene = scene(tmp_path, ball(), **noise)
    noisy = echoes(noisy_scene, frames=3).capture.samples
    deviation = noisy - clean
    assert np.array_equal(clean[0], clean[2]) and not np.array_equal(deviation[0], deviation[1])
    level = np.sqrt(np.mean(np.abs(deviation) ** 2, axis=(2, 3)))
    assert level == pytest.approx(level.mean(), rel=0.05)  # 8836 draws each: 0.5 % (1σ)
    # a frame does not depend on how many there are
    assert np.array_equal(echoes(noisy_scene, frames=2).capture.samples, noisy[:2])


def test_coarse_meshes_are_split_until_they_sample_the_wavelength(tmp_path):
    surface = visible_surface(scene(tmp_path, ball(resolution=10)))
    # A quarter of the wavelength bounds the edges, and with them the facets' area: √3/4 · (0.915
    # mm)².
    assert surface.weight.max() < np.sqrt(3) / 4 * 0.000915**2 * 1.01
    fine = {"sweep": [], "tones_hz": [9e12]}
    with pytest.raises(HandbenchError, match="remesh"):
        visible_surface(scene(tmp_path, ball(0.02), sensor=fine))


def test_a_mesh_that_faces_away_is_refused(tmp_path):
    away = mesh(np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(HandbenchError, match="no facet of its mesh faces the array"):
        echoes(scene(tmp_path, away, effects=["obliquity"]))


def test_tones_are_measured_in_the_order_of_the_file(tmp_path):
    sweep = [{"start_hz": 72e9, "stop_hz": 74e9, "count": 3}]
    sensor = {"sweep": sweep, "tones_hz": [82e9, 81.8e9], "step_time_s": 2e-3}
    found = echo_scene(scene(tmp_path, ball(), sensor=sensor))
    assert found.frequencies_hz == pytest.approx([72e9, 73e9, 74e9, 81.8e9, 82e9])
    assert found.time_s == pytest.approx([0, 2e-3, 4e-3, 8e-3, 6e-3])


def test_repeated_tones_are_kept_in_the_order_of_their_times(tmp_path):
    tones_hz = [82e9, 81.8e9, 79.5e9, 82e9]
    sensor = {"sweep": [], "tones_hz": tones_hz, "step_time_s": 2e-3}
    noise = {"effects": ["obliquity", "noise"], "noise": {"phase_noise_rad": 3e-4}}
    capture = echoes(scene(tmp_path, ball(), sensor=sensor, **noise)).capture
    assert capture.frequencies_hz.tolist() == tones_hz
    assert capture.times_s == pytest.approx([0, 2e-3, 4e-3, 6e-3])
    # the same target at rest, with other noise
    first, *_, last = capture.samples[0]
    assert 1e-3 < np.linalg.norm(first - last) / np.linalg.norm(first) < 0.1
    still = {"effects": ["obliquity"]}
    once = echoes(scene(tmp_path, ball(), sensor=sensor | {"tones_hz": tones_hz[:3]}, **still))
    again = echoes(scene(tmp_path, ball(), sensor=sensor, **still)).capture.samples[0]
    expected = once.capture.samples[0][[2, 1, 0, 2]]
    assert once.capture.times_s is None
    assert np.linalg.norm(again - expected) < 1e-5 * np.linalg.norm(expected)  # fast summation


def test_the_stand_is_seen_where_it_reflects(tmp_path):
    assert echo_scene(scene(tmp_path, ball())).room == ()
    stand = {"reflectivity_db": -20.0, "empty": True}
    seen, subtracted = (
        scene(tmp_path, ball(), stand=stand | {"subtract": subtract}, effects=["clutter"])
        for subtract in (False, True)
    )
    [plate] = echo_scene(seen).room
    assert np.linalg.norm(plate.vertices_m[:, :2].max(axis=0) - [0.2, 0.15]) < 0.02
    assert plate.vertices_m[:, 2].min() > 0.37
    simulated = echoes(seen)
    assert np.abs(simulated.empty.samples).max() > 0
    bare = echoes(subtracted).capture.samples
    assert np.array_equal(bare, simulated.capture.samples - simulated.empty.samples[0])


def test_palms_are_palmar_and_backs_are_not():
    """The palm's centre is at y = -0.03; B lays the thumb's back on the palm."""
    target = {"kind": "hand", "pose": "B", "edge_m": 4e-3, "material": {"kind": "skin"}}
    body = echo_scene(built({"target": target})).target
    a, b, c = body.vertices_m[body.faces].swapaxes(0, 1)
    normal, hand = np.cross(b - a, c - a), a[:, 1] > -0.06
    cosine = normal[:, 2] / np.linalg.norm(normal, axis=1)
    assert body.palm[hand & (cosine < -0.7)].mean() > 0.85
    assert body.palm[hand & (cosine > 0.7)].mean() < 0.05
    assert not body.palm[a[:, 1] < -0.11].any()  # the forearm


def built(values, folder="."):
    return build(parse(SceneFile, {"version": 1, "name": "s", **values}, "test"), folder)


def test_only_the_near_side_of_a_ball_is_seen_and_what_stands_behind_is_in_the_shadow(tmp_path):
    """From a distance R one sees the cap of height a(1 − a/R) of a sphere: area 2πa²(1 − a/R), here
    0.00235 m²."""
    cap_m2 = 2 * np.pi * 0.02**2 * (1 - 0.02 / 0.3)
    for seen in (ball(), ball() + ball(0.015, 0.05)):
        surface = visible_surface(scene(tmp_path, seen))
        assert surface.weight.sum() == pytest.approx(cap_m2, rel=0.02)
        assert (surface.position_m[:, 2] < 0.30).all()
        assert np.linalg.norm(surface.normal, axis=1) == pytest.approx(1)
