"""Scene files: strictness, frames and placement, and the folder that is written."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.simulated import simulate_capture, write_photos
from handbench.bench.scenes.build import Scene, build, spheres
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.stand import stand_board
from handbench.calibration.spheres.description import default_target, load_target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.board.board import load_board
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.mesh_files import read_mesh, read_triangles, write_mesh
from handbench.radar.data.echoes_file import load_capture
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

HAND = {
    "version": 1,
    "name": "b",
    "target": {"kind": "hand", "pose": "B", "edge_m": 4e-3},
    "photos": {},
}
BALL, B = {"kind": "sphere", "edge_m": 2e-3}, HAND["target"]
TARGET = {"version": 1, "name": "t", "target": {"kind": "calibration_target"}}


def scene_file(values: dict) -> SceneFile:
    return parse(SceneFile, values, "scene.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sed": 1}, "unknown key 'sed'; did you mean 'seed'"),
        ({"target": {"kind": "hand", "pose": "J"}}, "this name is unknown"),
        ({"target": {"kind": "hand", "pose": {"index": {"mcp": 3}}}}, "did you mean 'mcp_deg'"),
        ({"target": {"kind": "sphere", "offset_m": [1e300, 0]}}, "less than or equal to 100"),
        ({"target": {"kind": "sphere", "motion": {"direction": [0, 0, 0]}}}, "a direction"),
        ({"target": BALL | {"motion": {"pose": "F"}}}, "unknown key 'target.motion.pose'"),
        ({"target": B | {"motion": {"pose": "J", "duration_s": 1.0}}}, "this name is unknown"),
        ({"target": B | {"motion": {"pose": "F"}}}, "give both or neither"),
        ({"target": B | {"motion": {"duration_s": 1.0}}}, "give both or neither"),
        ({"target": BALL | {"motion": {"rotation_deg_s": [9e9, 0, 0]}}}, "rotation_deg_s"),
        ({"sensor": {"frame_period_s": 0.1}}, "a frame of 128 tones takes 0.128 s"),
        ({"sensor": {"sweep": []}}, "the radar has no tones"),
        ({"name": "../b"}, "'name'"),
        ({"noise": {"phase_noise_rad": float("nan")}}, "finite"),
        ({"noise": {"phase_noise_rad": 0.1, "snr_db": 20.0}}, "both given"),
        ({"effects": ["noise", "shade"]}, "this name is unknown"),
    ],
)
def test_mistakes_are_named(change: dict, message: str) -> None:
    with pytest.raises(HandbenchError, match=r"scene\.toml") as error:
        scene_file(HAND | change)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_hand_scene_geometry() -> None:
    scene = build(scene_file(HAND))
    vertices_m, box_m = np.asarray(scene.target_mesh.vertices), scene.box_m
    assert vertices_m[:, 2].min() > 0.25 and vertices_m[:, 2].max() < 0.33
    assert np.abs(vertices_m[:, :2]).max() < 0.15  # the paper's image
    turn = scene.radar_from_photo.rotation
    assert np.linalg.det(turn) == pytest.approx(1.0)
    # the board looks at the radar, but not squarely
    assert turn[2, 2] < -0.95 and np.abs(turn - np.diag([-1, 1, -1])).max() > 0.02
    in_photo_m = scene.radar_from_photo.inverse().points(vertices_m)
    inside = ((in_photo_m > box_m[0]) & (in_photo_m < box_m[1])).all(axis=1)
    assert inside.mean() > 0.85  # all but the end of the forearm, in its block
    assert max(in_photo_m[~inside, 1].max(), scene.block_m[1, 1]) < box_m[0, 1]
    assert box_m[0, 2] > 0.03  # well before the plate


def test_cameras_stand_around_the_radar_and_see_the_target() -> None:
    scene = build(scene_file(HAND))
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    corners_m = np.concatenate(list(stand_board().corners_m().values()))
    assert len({camera.params for camera in scene.cameras}) == len(scene.cameras) == 8
    for camera in scene.cameras:
        centre = scene.radar_from_photo.points(camera.centre_m)
        assert np.hypot(*centre[:2]) > 0.12
        pixels = camera.project(np.concatenate([vertices_m, corners_m]))
        seen = ((pixels > 0) & (pixels < [camera.width, camera.height])).all(axis=1)
        assert seen[: len(vertices_m)].all() and seen[len(vertices_m) :].mean() > 0.6
        spacing_m = np.linalg.norm(vertices_m.mean(axis=0) - camera.centre_m) / camera.params[0]
        assert 0.15e-3 < spacing_m < 0.18e-3
    one, again, other = (
        build(scene_file(TARGET | {"photos": {}, "seed": seed})).cameras for seed in (1, 1, 2)
    )
    assert one == again != other  # the seed alone moves them


def test_calibration_target_is_placed_and_turned() -> None:
    scene = build(scene_file(TARGET))
    assert scene.balls_m.mean(axis=0) == pytest.approx([0, 0, 0.30], abs=0.01)
    assert np.ptp(scene.balls_m[:4, 2]) > 5e-3
    off_m = np.asarray(scene.target_mesh.vertices)[:, None] - scene.balls_m
    radii_m = np.array([element.sphere_radius_m for element in scene.target.element])
    assert np.abs(np.linalg.norm(off_m, axis=2) - radii_m).min(axis=1).max() < 1e-5
    assert scene.block_m is None and scene.cameras == ()


def test_mesh_target_from_a_file_in_millimetres(tmp_path: Path) -> None:
    write_mesh(tmp_path / "part.ply", spheres(default_target()).scale(1e3, np.zeros(3)))
    target = {"kind": "mesh", "path": "part.ply", "unit": "mm", "distance_m": 0.29}
    scene = build(scene_file({"version": 1, "name": "part", "target": target}), tmp_path)
    vertices = np.asarray(scene.target_mesh.vertices)
    assert vertices[:, 2].mean() == pytest.approx(0.29, abs=0.005)
    assert np.ptp(vertices[:, 0]) == pytest.approx(0.17, abs=1e-3)


@pytest.mark.parametrize(
    ("target", "size_m"),
    [
        ({"kind": "sphere", "radius_m": 0.02}, (0.04, 0.04, 0.04)),
        ({"kind": "plate", "width_m": 0.1, "height_m": 0.06}, (0.1, 0.06, 0.002)),
        ({"kind": "dihedral", "side_m": 0.05}, (0.05 * 2**0.5, 0.05, 0.05 / 2**0.5 + 0.005)),
    ],
)
def test_shapes_are_closed_and_have_their_size(target: dict, size_m: tuple) -> None:
    placed = {**target, "edge_m": 2e-3, "distance_m": 0.3}
    mesh = build(scene_file({"version": 1, "name": "s", "target": placed})).target_mesh
    assert np.asarray(mesh.vertices).mean(axis=0)[:2] == pytest.approx([0, 0], abs=1e-3)
    assert mesh.get_max_bound() - mesh.get_min_bound() == pytest.approx(size_m, rel=0.01)
    corners_m = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)] - [0, 0, 0.3]
    flux = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    assert np.abs(flux.sum(axis=0)).max() < 1e-12  # closed
    assert np.linalg.det(corners_m).sum() > 0  # outwards


def test_capture_folder(tmp_path: Path) -> None:
    photos = {"cameras": 2, "width": 300, "height": 200}
    scene = build(scene_file(TARGET | {"photos": photos, "seed": 4}))
    write_photos(scene, tmp_path)
    content = tomllib.loads((tmp_path / "capture.toml").read_text())
    assert (content["kind"], content["units"], content["version"]) == ("target", "m", 1)
    assert all((tmp_path / name).exists() for name in content["contains"])
    assert np.allclose(content["box_m"], scene.box_m.ravel(), atol=1e-6)
    assert load_target(tmp_path / "target.toml") == scene.target
    assert load_board(tmp_path / "photos" / "board.toml") == stand_board()
    assert all(camera.R is None for camera in load_cameras(tmp_path / "photos" / "cameras.json"))
    assert load_cameras(tmp_path / "photos" / "truth_cameras.json") == scene.cameras
    found = load_transform(tmp_path / "truth_radar_from_photo.json").matrix
    assert np.allclose(found, scene.radar_from_photo.matrix)
    assert len(read_mesh(tmp_path / "truth.ply").triangles) == len(scene.target_mesh.triangles)


def moving(motion: dict, **target: object) -> Scene:
    """A scene of four tones, two of them at 82 GHz, whose target moves on from frame to frame."""
    sensor = {"sweep": [], "tones_hz": [82e9, 81.8e9, 79.5e9, 82e9], "frame_period_s": 0.1}
    target = {"motion": motion, "distance_m": 0.3, **target}
    values = {"target": target, "sensor": sensor, "effects": ["motion"]}
    return build(scene_file({"version": 1, "name": "m", **values}))


def test_truth_of_a_moving_target(tmp_path: Path) -> None:
    """One surface a frame, with velocities; of a calibration target, too."""
    motion = {"rotation_deg_s": [0.0, 0.0, 90.0], "velocity_m_s": 0.1, "direction": [1, 0, 0]}
    for target in (BALL | {"offset_m": [0.02, 0.0]}, {"kind": "calibration_target"}):
        folder, scene = tmp_path / target["kind"], moving(motion, **target)
        simulate_capture(scene, folder, frames=2)
        content = tomllib.loads((folder / "capture.toml").read_text())
        assert {"truth", "truth.ply"} <= set(content["contains"])
        assert (folder / "truth.ply").read_bytes() == (folder / "truth/000.ply").read_bytes()
        assert len(list((folder / "truth").iterdir())) == 2
        capture = load_capture(folder / "echoes.h5")
        assert capture.times_s == pytest.approx([0, 1e-3, 2e-3, 3e-3])
        assert capture.frame_times_s == pytest.approx([0, 0.1])
        still_m = np.asarray(scene.target_mesh.vertices)
        pivot_m, c, s = (
            scene.radar_from_target.matrix[:3, 3],
            np.cos(np.pi / 20),
            np.sin(np.pi / 20),
        )
        for frame, turn in enumerate((np.eye(3), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))):
            vertices_m, faces, more = read_triangles(folder / f"truth/{frame:03}.ply")
            around_m = (still_m - pivot_m) @ turn.T
            there_m = around_m + pivot_m + [0.01 * frame, 0, 0]
            assert np.abs(vertices_m - there_m).max() < 1e-12
            assert np.array_equal(faces, np.asarray(scene.target_mesh.triangles))
            velocity = np.stack([more["vx"], more["vy"], more["vz"]], axis=1)
            expected = np.cross([0, 0, np.pi / 2], around_m) + [0.1, 0, 0]
            assert np.abs(velocity - expected).max() < 1e-8


def test_a_target_at_rest_has_one_truth_without_times(tmp_path: Path) -> None:
    sensor = {"sweep": [], "tones_hz": [82e9, 81.8e9], "frame_period_s": 0.1}
    values = {"target": BALL, "sensor": sensor, "effects": ["obliquity"]}
    scene = build(scene_file({"version": 1, "name": "s", **values}))
    simulate_capture(scene, tmp_path / "c", frames=2)
    assert not (tmp_path / "c/truth").exists()
    assert load_capture(tmp_path / "c/echoes.h5").times_s is None


LARGE = {"kind": "sphere", "radius_m": 0.5, "edge_m": 1e-4, "distance_m": 1}


@pytest.mark.parametrize(
    ("target", "more", "message"),
    [
        ({"kind": "mesh", "path": "../secret.ply"}, {}, "is outside the folder"),
        (HAND["target"], {"photos": {}, "mount": {"offset_m": [0, 0, 0.32]}}, "back plate"),
        ({"kind": "sphere", "distance_m": 0.01}, {}, "behind the plane of the array"),
        (LARGE, {}, "triangles"),
    ],
)
def test_targets_that_no_scene_can_have_are_refused(
    target: dict, more: dict, message: str, tmp_path: Path
) -> None:
    with pytest.raises(HandbenchError, match=message):
        build(scene_file({"version": 1, "name": "s", "target": target, **more}), tmp_path)
