"""Scene files: strictness, frames and placement, and the folder that is written."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.simulated import simulate_capture, write_photos
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.stand import stand_board
from handbench.calibration.target import load_target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.board import load_board
from handbench.groundtruth.cameras import load_cameras
from handbench.groundtruth.mesh.surface import mesh, read_mesh, read_triangles, write_mesh
from handbench.radar.data.echoes_file import load_capture
from handbench.support.config import parse
from tests.refusals import refuse

BALL, HAND = {"kind": "sphere", "edge_m": 2e-3}, {"kind": "hand", "pose": "B", "edge_m": 4e-3}
TARGET = {"kind": "calibration_target"}


def built(target: dict, folder: Path | str = ".", **values: object) -> Scene:
    values = {"version": 1, "name": "s", "target": target} | values
    return build(parse(SceneFile, values, "scene.toml"), folder)


@pytest.mark.parametrize(
    ("target", "values", "place"),
    [
        ({"kind": "hand", "pose": "J"}, {}, "target.pose"),
        ({"kind": "balll"}, {}, "'target.kind' is 'balll'"),
        (HAND | {"motion": {"pose": "F"}}, {}, "duration_s"),
        (BALL | {"motion": {"direction": [0, 0, 0]}}, {}, "direction"),
        (BALL, {"sensor": {"frame_period_s": 0.1}}, "0.128 s"),
        (BALL, {"sensor": {"sweep": []}}, "tones_hz"),
        (BALL, {"sensor": {"tones_hz": [8e10] * 20_000}}, "20128"),
        (BALL, {"noise": {"phase_noise_rad": 0.1, "snr_db": 20.0}}, "snr_db"),
        (BALL, {"effects": ["noise", "shade"]}, "effects.1"),
        ({"kind": "mesh", "path": "../secret.ply"}, {}, "../secret.ply"),
        (HAND, {"photos": {}, "mount": {"offset_m": [0, 0, 0.32]}}, "mount.offset_m"),
        (BALL | {"distance_m": 0.01}, {}, "target.distance_m"),
        (BALL | {"radius_m": 0.5, "edge_m": 1e-4, "distance_m": 1}, {}, "target.edge_m"),
    ],
)
def test_scenes_that_cannot_be_are_refused(target: dict, values: dict, place: str) -> None:
    refuse(lambda: built(target, **values), "s", place)


def test_hand_scene_geometry() -> None:
    scene = built(HAND)
    vertices_m, box_m = np.asarray(scene.target_mesh.vertices), scene.box_m
    assert vertices_m[:, 2].min() > 0.25 and vertices_m[:, 2].max() < 0.33
    assert np.abs(vertices_m[:, :2]).max() < 0.15  # the paper's image
    in_photo_m = scene.radar_from_photo.inverse().points(vertices_m)
    inside = ((in_photo_m > box_m[0]) & (in_photo_m < box_m[1])).all(axis=1)
    assert inside.mean() > 0.85  # all but the end of the forearm, in its block
    assert max(in_photo_m[~inside, 1].max(), scene.block_m[1, 1]) < box_m[0, 1]
    assert box_m[0, 2] > 0.03  # well before the plate


def test_cameras_stand_around_the_radar_and_see_the_target() -> None:
    scene = built(HAND, photos={})
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    corners_m = np.concatenate(list(stand_board().corners_m().values()))
    assert len({camera.params for camera in scene.cameras}) == len(scene.cameras) == 8
    for camera in scene.cameras:
        centre_m = scene.radar_from_photo.points(camera.centre_m)
        assert np.hypot(*centre_m[:2]) > 0.12
        pixels = camera.project(np.concatenate([vertices_m, corners_m]))
        seen = ((pixels > 0) & (pixels < [camera.width, camera.height])).all(axis=1)
        assert seen[: len(vertices_m)].all() and seen[len(vertices_m) :].mean() > 0.6
        spacing_m = np.linalg.norm(vertices_m.mean(axis=0) - camera.centre_m) / camera.params[0]
        assert 0.15e-3 < spacing_m < 0.18e-3
    one, same, other = (built(BALL, photos={}, seed=seed).cameras for seed in (1, 1, 2))
    assert one == same != other  # the seed alone moves them


def test_calibration_target_is_placed_and_turned() -> None:
    scene = built(TARGET)
    assert scene.balls_m.mean(axis=0) == pytest.approx([0, 0, 0.30], abs=0.01)
    assert np.ptp(scene.balls_m[:4, 2]) > 5e-3
    off_m = np.asarray(scene.target_mesh.vertices)[:, None] - scene.balls_m
    radii_m = np.array([element.sphere_radius_m for element in scene.target.element])
    assert np.abs(np.linalg.norm(off_m, axis=2) - radii_m).min(axis=1).max() < 1e-5
    assert scene.block_m is None


def test_mesh_target_from_a_file_in_millimetres(tmp_path: Path) -> None:
    corners_mm = np.array([[0.0, 0, 0], [0, 30, 0], [20, 0, 0]])
    write_mesh(tmp_path / "part.ply", mesh(corners_mm, np.array([[0, 1, 2]])))
    target = {"kind": "mesh", "path": "part.ply", "unit": "mm", "distance_m": 0.29}
    vertices_m = np.asarray(built(target, tmp_path).target_mesh.vertices)
    np.testing.assert_allclose(vertices_m, 1e-3 * corners_mm + [0, 0, 0.29], atol=1e-9)  # float32


@pytest.mark.parametrize(
    ("target", "size_m"),
    [
        ({"kind": "sphere", "radius_m": 0.02}, (0.04, 0.04, 0.04)),
        ({"kind": "plate", "width_m": 0.1, "height_m": 0.06}, (0.1, 0.06, 0.002)),
        ({"kind": "dihedral", "side_m": 0.05}, (0.05 * 2**0.5, 0.05, 0.05 / 2**0.5 + 0.005)),
    ],
)
def test_shapes_are_closed_and_have_their_size(target: dict, size_m: tuple) -> None:
    surface = built(target | {"edge_m": 2e-3, "distance_m": 0.3}).target_mesh
    assert surface.get_max_bound() - surface.get_min_bound() == pytest.approx(size_m, rel=0.01)
    corners_m = np.asarray(surface.vertices)[np.asarray(surface.triangles)] - [0, 0, 0.3]
    flux = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    assert np.abs(flux.sum(axis=0)).max() < 1e-12  # closed
    assert np.linalg.det(corners_m).sum() > 0  # outwards


def test_capture_folder(tmp_path: Path) -> None:
    scene = built(BALL, photos={"cameras": 2, "width": 300, "height": 200}, seed=4)
    rows = {row.effect: row.on for row in write_photos(scene, tmp_path)}
    assert rows == {"photos.blur": True, "photos.noise": True}
    content = tomllib.loads((tmp_path / "capture.toml").read_text())
    assert (content["kind"], content["units"], content["version"]) == ("other", "m", 1)
    assert all((tmp_path / name).exists() for name in content["contains"])
    assert np.allclose(content["box_m"], scene.box_m.ravel(), atol=1e-6)
    assert load_board(tmp_path / "photos" / "board.toml") == stand_board()
    assert all(camera.R is None for camera in load_cameras(tmp_path / "photos" / "cameras.json"))
    assert load_cameras(tmp_path / "photos" / "truth_cameras.json") == scene.cameras
    matrix = load_transform(tmp_path / "truth_radar_from_photo.json").matrix
    assert np.allclose(matrix, scene.radar_from_photo.matrix)
    assert len(read_mesh(tmp_path / "truth.ply").triangles) == len(scene.target_mesh.triangles)


def test_a_broken_array_is_refused_before_anything_is_simulated(tmp_path: Path) -> None:
    (tmp_path / "tx_m.csv").write_text("x,y,z\n0,0,0\n")
    refuse(lambda: built(BALL, tmp_path, sensor={"array": "."}), "tx_m.csv")


@pytest.mark.parametrize("target", [BALL | {"offset_m": [0.02, 0.0]}, TARGET])
def test_a_moving_target_has_one_truth_a_frame_with_velocities(
    target: dict, tmp_path: Path
) -> None:
    """Four tones, two of them at 82 GHz, before two antennas, for speed."""
    for name in ("tx_m.csv", "rx_m.csv"):
        (tmp_path / name).write_text("x_m,y_m,z_m\n0.01,0,0\n0,0.02,0\n")
    sensor = {"sweep": [], "tones_hz": [82e9, 81.8e9, 79.5e9, 82e9], "array": "."}
    sensor["frame_period_s"] = 0.1
    motion = {"rotation_deg_s": [0.0, 0.0, 90.0], "velocity_m_s": 0.1, "direction": [1, 0, 0]}
    target, folder = target | {"motion": motion}, tmp_path / "out"
    scene = built(target, tmp_path, sensor=sensor, effects=["motion"])
    simulate_capture(scene, folder, frames=2)
    assert (folder / "truth.ply").read_bytes() == (folder / "truth/000.ply").read_bytes()
    capture = load_capture(folder / "echoes.h5")
    assert capture.aperture.tx_m[1].tolist() == [0, 0.02, 0]
    assert capture.times_s == pytest.approx([0, 1e-3, 2e-3, 3e-3])
    assert capture.frame_times_s == pytest.approx([0, 0.1])
    if scene.target is not None:
        assert load_target(folder / "target.toml") == scene.target
    pivot_m = scene.radar_from_target.matrix[:3, 3]
    turns = Rotation.from_rotvec([[0, 0, 0], [0, 0, np.pi / 20]]).as_matrix()
    for frame, turn in enumerate(turns):
        vertices_m, faces, more = read_triangles(folder / f"truth/{frame:03}.ply")
        around_m = (np.asarray(scene.target_mesh.vertices) - pivot_m) @ turn.T
        there_m = around_m + pivot_m + [0.01 * frame, 0, 0]
        assert np.abs(vertices_m - there_m).max() < 1e-12
        assert np.array_equal(faces, np.asarray(scene.target_mesh.triangles))
        velocity = np.stack([more["vx"], more["vy"], more["vz"]], axis=1)
        expected = np.cross([0, 0, np.pi / 2], around_m) + [0.1, 0, 0]
        assert np.abs(velocity - expected).max() < 1e-8
