"""Echoes of scenes: bodies, balls, room and causes reach the radar as the scene file says."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.simulate import SimulatedCapture
from handbench.support.config import parse
from tests.radar.samples import relative_error

TONES = {"sweep": [], "tones_hz": [82e9, 81.8e9]}
SPARSE = AntennaArray(qar50().tx_m[::4], qar50().rx_m[::4])  # for speed


def scene(**changes) -> Scene:
    target = {"kind": "sphere", "radius_m": 0.02, "edge_m": 2e-3}
    values = {"version": 1, "name": "s", "seed": 5, "target": target, "sensor": TONES}
    return build(parse(SceneFile, values | changes, "test"))


def sparse_echoes(of: Scene, frames: int = 1) -> SimulatedCapture:
    return echoes(of, frames, replace(echo_scene(of), array=SPARSE, coarser=4.0))


def test_frames_differ_in_their_noise_alone():
    clean = sparse_echoes(scene(effects=["obliquity"]), frames=2).capture.samples
    noise = {"effects": ["obliquity", "noise"], "noise": {"phase_noise_rad": 0.03}}
    three, two = (sparse_echoes(scene(**noise), frames).capture.samples for frames in (3, 2))
    deviation = two - clean
    assert np.array_equal(clean[0], clean[1]) and not np.array_equal(deviation[0], deviation[1])
    assert np.array_equal(three[:2], two)  # a frame does not depend on how many there are


def test_tones_are_measured_in_the_order_of_the_file():
    sweep = [{"start_hz": 72e9, "stop_hz": 74e9, "count": 3}]
    sensor = {"sweep": sweep, "tones_hz": [82e9, 81.8e9], "step_time_s": 2e-3}
    radar_scene = echo_scene(scene(sensor=sensor))
    assert radar_scene.frequencies_hz == pytest.approx([72e9, 73e9, 74e9, 81.8e9, 82e9])
    assert radar_scene.time_s == pytest.approx([0, 2e-3, 4e-3, 8e-3, 6e-3])


def test_repeated_tones_are_kept_in_the_order_of_their_times():
    sensor = {"sweep": [], "tones_hz": [82e9, 81.8e9, 79.5e9, 82e9], "step_time_s": 2e-3}
    capture, once = (
        sparse_echoes(scene(sensor=sensor | tones, effects=["obliquity"])).capture
        for tones in ({}, {"tones_hz": sensor["tones_hz"][:3]})
    )
    assert capture.frequencies_hz.tolist() == sensor["tones_hz"]
    assert capture.times_s == pytest.approx([0, 2e-3, 4e-3, 6e-3]) and once.times_s is None
    expected = once.samples[0][[2, 1, 0, 2]]
    assert relative_error(capture.samples[0], expected) < 1e-5  # fast summation


def test_the_stand_is_seen_where_it_reflects():
    assert echo_scene(scene()).room == ()
    stand = {"reflectivity_db": -20.0, "empty": True}
    seen, subtracted = (
        scene(stand=stand | {"subtract": subtract}, effects=["clutter"])
        for subtract in (False, True)
    )
    [plate] = echo_scene(seen).room
    assert np.linalg.norm(plate.vertices_m[:, :2].max(axis=0) - [0.2, 0.15]) < 0.02
    assert plate.vertices_m[:, 2].min() > 0.37
    simulated, bare = sparse_echoes(seen), sparse_echoes(subtracted).capture.samples
    assert np.abs(simulated.empty.samples).max() > 0
    assert np.array_equal(bare, simulated.capture.samples - simulated.empty.samples[0])


def test_palms_are_palmar_and_backs_are_not():
    """The palm's centre is at y = -0.03; B lays the thumb's back on the palm."""
    target = {"kind": "hand", "pose": "B", "edge_m": 4e-3, "material": {"kind": "skin"}}
    body = echo_scene(scene(target=target)).target
    a, b, c = body.vertices_m[body.faces].swapaxes(0, 1)
    normal, hand = np.cross(b - a, c - a), a[:, 1] > -0.06
    cosine = normal[:, 2] / np.linalg.norm(normal, axis=1)
    assert body.palm[hand & (cosine < -0.7)].mean() > 0.85
    assert body.palm[hand & (cosine > 0.7)].mean() < 0.05
    assert not body.palm[a[:, 1] < -0.11].any()  # the forearm
