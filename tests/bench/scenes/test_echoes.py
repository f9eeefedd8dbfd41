"""Echoes of scenes: bodies, balls, room and causes reach the radar as the scene file says."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.simulate import SimulatedCapture
from handbench.support.config import parse

TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9]}
SPARSE = AntennaArray(qar50().tx_m[::4], qar50().rx_m[::4])  # for speed


def scene(folder, **changes) -> Scene:
    """A ball, whose file is in the folder."""
    write_mesh(folder / "body.ply", load_open3d().geometry.TriangleMesh.create_sphere(0.02, 40))
    target = {"kind": "mesh", "path": "body.ply", "distance_m": 0.3}
    values = {"version": 1, "name": "s", "seed": 5, "target": target, "sensor": TONES}
    return build(parse(SceneFile, values | changes, "test"), folder)


def sparse_echoes(of: Scene, frames: int = 1) -> SimulatedCapture:
    return echoes(of, frames, replace(echo_scene(of), array=SPARSE, coarser=4.0))


def test_frames_differ_in_their_noise_alone(tmp_path):
    effects, noise = ["obliquity", "shadow"], {"phase_noise_rad": 0.03}
    clean = sparse_echoes(scene(tmp_path, effects=effects), frames=3).capture.samples
    noisy_scene = scene(tmp_path, effects=[*effects, "noise"], noise=noise)
    noisy = sparse_echoes(noisy_scene, frames=3).capture.samples
    deviation = noisy - clean
    assert np.array_equal(clean[0], clean[2]) and not np.array_equal(deviation[0], deviation[1])
    level = np.sqrt(np.mean(np.abs(deviation) ** 2, axis=(2, 3)))
    assert level == pytest.approx(level.mean(), rel=0.1)  # 576 draws each: 2.1 % (1σ)
    # a frame does not depend on how many there are
    assert np.array_equal(sparse_echoes(noisy_scene, frames=2).capture.samples, noisy[:2])


def test_tones_are_measured_in_the_order_of_the_file(tmp_path):
    sweep = [{"start_hz": 72e9, "stop_hz": 74e9, "count": 3}]
    sensor = {"sweep": sweep, "tones_hz": [82e9, 81.8e9], "step_time_s": 2e-3}
    radar_scene = echo_scene(scene(tmp_path, sensor=sensor))
    assert radar_scene.frequencies_hz == pytest.approx([72e9, 73e9, 74e9, 81.8e9, 82e9])
    assert radar_scene.time_s == pytest.approx([0, 2e-3, 4e-3, 8e-3, 6e-3])


def test_repeated_tones_are_kept_in_the_order_of_their_times(tmp_path):
    sensor = {"sweep": [], "tones_hz": [82e9, 81.8e9, 79.5e9, 82e9], "step_time_s": 2e-3}
    capture, once = (
        sparse_echoes(scene(tmp_path, sensor=sensor | tones, effects=["obliquity"])).capture
        for tones in ({}, {"tones_hz": sensor["tones_hz"][:3]})
    )
    assert capture.frequencies_hz.tolist() == sensor["tones_hz"]
    assert capture.times_s == pytest.approx([0, 2e-3, 4e-3, 6e-3]) and once.times_s is None
    expected = once.samples[0][[2, 1, 0, 2]]
    deviation = np.linalg.norm(capture.samples[0] - expected)
    assert deviation < 1e-5 * np.linalg.norm(expected)  # fast summation


def test_the_stand_is_seen_where_it_reflects(tmp_path):
    assert echo_scene(scene(tmp_path)).room == ()
    stand = {"reflectivity_db": -20.0, "empty": True}
    seen, subtracted = (
        scene(tmp_path, stand=stand | {"subtract": subtract}, effects=["clutter"])
        for subtract in (False, True)
    )
    [plate] = echo_scene(seen).room
    assert np.linalg.norm(plate.vertices_m[:, :2].max(axis=0) - [0.2, 0.15]) < 0.02
    assert plate.vertices_m[:, 2].min() > 0.37
    simulated, bare = sparse_echoes(seen), sparse_echoes(subtracted).capture.samples
    assert np.abs(simulated.empty.samples).max() > 0
    assert np.array_equal(bare, simulated.capture.samples - simulated.empty.samples[0])


def test_palms_are_palmar_and_backs_are_not(tmp_path):
    """The palm's centre is at y = -0.03; B lays the thumb's back on the palm."""
    target = {"kind": "hand", "pose": "B", "edge_m": 4e-3, "material": {"kind": "skin"}}
    body = echo_scene(scene(tmp_path, target=target)).target
    a, b, c = body.vertices_m[body.faces].swapaxes(0, 1)
    normal, hand = np.cross(b - a, c - a), a[:, 1] > -0.06
    cosine = normal[:, 2] / np.linalg.norm(normal, axis=1)
    assert body.palm[hand & (cosine < -0.7)].mean() > 0.85
    assert body.palm[hand & (cosine > 0.7)].mean() < 0.05
    assert not body.palm[a[:, 1] < -0.11].any()  # the forearm
