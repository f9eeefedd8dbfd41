"""Scene files: strictness, frames and placement, and the folder that is written."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.simulated import description, write_photos
from handbench.bench.scenes.build import build, load_scene, spheres
from handbench.bench.scenes.scene_file import Photos, SceneFile, Sensor, Sweep
from handbench.bench.scenes.stand import PLATE_M, cuboid, plate_print, stand_board
from handbench.calibration.spheres.description import default_target, load_target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.board.board import load_board
from handbench.groundtruth.cameras.cameras import load_cameras
from handbench.groundtruth.mesh.mesh_files import read_mesh, write_mesh
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

HAND = {
    "version": 1,
    "name": "b",
    "target": {"kind": "hand", "pose": "B", "edge_m": 4e-3},
    "photos": {},
}
TARGET = {"version": 1, "name": "t", "target": {"kind": "calibration_target"}}


def scene_file(values: dict) -> SceneFile:
    return parse(SceneFile, values, "scene.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sed": 1}, "unknown key 'sed'; did you mean 'seed'"),
        ({"target": {"kind": "hand", "pos": "B"}}, "did you mean 'pose'"),
        ({"target": {"kind": "hand", "pose": "J"}}, "unknown pose"),
        ({"target": {"kind": "foot"}}, "'foot'"),
        ({"target": {"kind": "mesh", "pth": "a.ply"}}, "did you mean 'path'"),
        ({"target": {"kind": "hand", "pose": "B", "distance_m": 0}}, "greater than 0"),
        ({"photos": {"camera": 8}}, "did you mean 'cameras'"),
        ({"sensor": {"sweep": [{"start_hz": 1, "stop": 2, "count": 3}]}}, "did you mean 'stop_hz'"),
        ({"version": 2}, "'version' is 2"),
        ({"name": "../b"}, "'name'"),
        ({"noise": {"phase_noise_rad": float("nan")}}, "finite"),
        ({"noise": {"phase_noise_rad": 0.1, "snr_db": 20.0}}, "either"),
        ({"effects": "all"}, '"auto" or a list'),
        ({"effects": ["noise", "shadow"]}, "'shadow' is not an effect"),
        ({"effects": ["noise", "noise"]}, "twice"),
        ({"tolerance_mm": 0}, "greater than 0"),
        ({"sensor": {"converter": {"bit": 12}}}, "did you mean 'bits'"),
        ({"target": {"kind": "hand", "pose": {"index": {"mcp": 3}}}}, "did you mean 'mcp_deg'"),
        (
            {"target": {"kind": "hand", "pose": {"index": {"mcp_deg": 300}}}},
            "less than or equal to",
        ),
        ({"target": {"kind": "hand", "pose": "B", "material": {"kind": "gold"}}}, "'gold'"),
        ({"target": {"kind": "sphere", "radius_m": -1}}, "greater than 0"),
    ],
)
def test_mistakes_are_named(change: dict, message: str) -> None:
    with pytest.raises(HandbenchError, match=r"scene\.toml") as error:
        scene_file(HAND | change)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_frequencies_keep_the_order_of_the_file() -> None:
    sensor = Sensor(sweep=(Sweep(start_hz=72e9, stop_hz=82e9, count=3),), tones_hz=(81.8e9,))
    assert sensor.frequencies_hz == pytest.approx([72e9, 77e9, 82e9, 81.8e9])


def test_hand_scene_geometry() -> None:
    scene = build(scene_file(HAND))
    vertices = np.asarray(scene.target_mesh.vertices)
    assert vertices[:, 2].min() > 0.25 and vertices[:, 2].max() < 0.33
    assert np.abs(vertices[:, :2]).max() < 0.15  # the paper's image
    radar_from_photo = scene.radar_from_photo
    assert np.linalg.det(radar_from_photo.rotation) == pytest.approx(1.0)
    assert radar_from_photo.rotation[2, 2] < -0.95  # the board looks at the radar
    assert np.abs(radar_from_photo.rotation - np.diag([-1, 1, -1])).max() > 0.02  # but not squarely
    in_photo_m = radar_from_photo.inverse().points(vertices)
    inside = ((in_photo_m > scene.box_m[0]) & (in_photo_m < scene.box_m[1])).all(axis=1)
    assert inside.mean() > 0.85  # all but the end of the forearm, in its block
    assert in_photo_m[~inside, 1].max() < scene.box_m[0, 1]
    assert scene.box_m[0, 2] > 0.03  # well before the plate
    assert scene.block_m[1, 1] < scene.box_m[0, 1]


def test_cameras_stand_around_the_radar_and_see_the_target() -> None:
    scene = build(scene_file(HAND))
    vertices = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    corners = np.concatenate(list(scene.board.corners_m().values()))
    assert len(scene.cameras) == 8
    for camera in scene.cameras:
        centre = scene.radar_from_photo.points(camera.centre_m)
        assert np.hypot(*centre[:2]) > 0.12
        line = np.array([0, 0, 0.3]) - centre
        at_aperture = (
            centre - centre[2] / line[2] * line
        )  # where the line of sight passes the array's plane
        assert np.hypot(*at_aperture[:2]) > 0.10  # outside the 14 cm aperture's corners
        pixels = camera.project(vertices)
        assert (pixels > 0).all() and (pixels < [camera.width, camera.height]).all()
        seen = camera.project(corners)
        assert ((seen > 0) & (seen < [camera.width, camera.height])).all(axis=1).mean() > 0.6
        spacing_m = np.linalg.norm(vertices.mean(axis=0) - camera.centre_m) / camera.params[0]
        assert 0.15e-3 < spacing_m < 0.18e-3
    intrinsics = {camera.params for camera in scene.cameras}
    assert len(intrinsics) == 8


def test_the_seed_alone_moves_the_cameras() -> None:
    first, again, other = (
        build(scene_file(TARGET | {"photos": {}, "seed": s})).cameras for s in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_calibration_target_is_placed_and_turned() -> None:
    scene = build(scene_file(TARGET))
    assert scene.balls_m.mean(axis=0) == pytest.approx([0, 0, 0.30], abs=0.01)
    assert np.ptp(scene.balls_m[:4, 2]) > 5e-3
    vertices = np.asarray(scene.target_mesh.vertices)
    nearest = np.linalg.norm(vertices[:, None] - scene.balls_m, axis=2).min(axis=1)
    radii = [e.sphere_radius_m for e in scene.target.element]
    assert min(radii) - 1e-5 < nearest.min() and nearest.max() < max(radii) + 1e-5
    assert scene.block_m is None
    assert scene.cameras == ()


def test_mesh_target_from_a_file_in_millimetres(tmp_path: Path) -> None:
    surface = spheres(default_target()).scale(1e3, np.zeros(3))
    write_mesh(tmp_path / "part.ply", surface)
    (tmp_path / "scene.toml").write_text(
        'version = 1\nname = "part"\n[target]\nkind = "mesh"\npath = "part.ply"\nunit = '
        '"mm"\ndistance_m = 0.29\n'
    )
    scene = load_scene(tmp_path / "scene.toml")
    assert np.asarray(scene.target_mesh.vertices)[:, 2].mean() == pytest.approx(0.29, abs=0.005)
    assert np.ptp(np.asarray(scene.target_mesh.vertices)[:, 0]) == pytest.approx(0.17, abs=1e-3)


def test_files_of_a_scene_stay_in_its_folder(tmp_path: Path) -> None:
    file = scene_file(
        {"version": 1, "name": "x", "target": {"kind": "mesh", "path": "../secret.ply"}}
    )
    with pytest.raises(HandbenchError, match="leaves the folder"):
        build(file, tmp_path)


def test_a_target_in_the_plate_is_refused() -> None:
    with pytest.raises(HandbenchError, match="back plate"):
        build(scene_file(HAND | {"mount": {"offset_m": [0, 0, 0.32]}}))


@pytest.mark.parametrize(
    ("target", "size_m"),
    [
        ({"kind": "sphere", "radius_m": 0.02}, (0.04, 0.04, 0.04)),
        ({"kind": "plate", "width_m": 0.1, "height_m": 0.06}, (0.1, 0.06, 0.002)),
        ({"kind": "dihedral", "side_m": 0.05}, (0.05 * 2**0.5, 0.05, 0.05 / 2**0.5 + 0.005)),
    ],
)
def test_shapes_are_closed_and_have_their_size(target: dict, size_m: tuple) -> None:
    scene = build(
        scene_file(
            {"version": 1, "name": "s", "target": {**target, "edge_m": 2e-3, "distance_m": 0.3}}
        )
    )
    assert np.asarray(scene.target_mesh.vertices).mean(axis=0)[:2] == pytest.approx(
        [0, 0], abs=1e-3
    )
    assert scene.target_mesh.get_max_bound() - scene.target_mesh.get_min_bound() == pytest.approx(
        size_m, rel=0.01
    )
    triangles = np.asarray(scene.target_mesh.vertices)[np.asarray(scene.target_mesh.triangles)] - [
        0,
        0,
        0.3,
    ]
    flux = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).sum(
        axis=0
    )
    assert np.abs(flux).max() < 1e-12  # closed
    volume = (
        np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    )
    assert volume > 0  # outwards


def test_joint_angles_may_be_free() -> None:
    free = {"kind": "hand", "edge_m": 4e-3, "pose": {"index": {"mcp_deg": 80, "pip_deg": 90}}}
    scene = build(scene_file(HAND | {"target": free}))
    straight = build(scene_file(HAND | {"target": {**free, "pose": {}}}))
    index = [np.asarray(s.target_mesh.vertices) for s in (scene, straight)]
    index = [v[np.abs(v[:, 0] + 0.03) < 0.012] for v in index]  # where the straight index finger is
    assert index[1][:, 1].max() - index[0][:, 1].max() > 0.03
    assert description(scene, [], ())["pose"] == "free"


def test_plate_carries_its_markers() -> None:
    board, image = stand_board(), plate_print(seed=3)
    assert len(board.marker) >= 12
    assert image.shape == (3000, 4000)
    corners = np.concatenate(list(board.corners_m().values()))
    assert (np.abs(corners[:, :2]) < np.array(PLATE_M[:2]) / 2).all()
    # Just inside the corners the border is black, just outside the paper is white.
    for marker in board.corners_m().values():
        for factor, dark in ((0.95, True), (1.1, False)):
            points = marker.mean(axis=0) + factor * (marker - marker.mean(axis=0))
            column = ((points[:, 0] + PLATE_M[0] / 2) / 1e-4).astype(int)
            row = ((PLATE_M[1] / 2 - points[:, 1]) / 1e-4).astype(int)
            assert ((image[row, column] < 0.2) == dark).all()


def test_cuboid_is_closed_and_outward() -> None:
    vertices, faces = cuboid(np.array([[0.0, 0, 0], [0.03, 0.02, 0.01]]), 4e-3)
    triangles = vertices[faces]
    volume = (
        np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    )
    assert volume == pytest.approx(6e-6)


def test_capture_folder(tmp_path: Path) -> None:
    photos = {"cameras": 2, "width": 300, "height": 200}
    scene = build(scene_file(TARGET | {"photos": photos, "seed": 4}))
    write_photos(scene, tmp_path)
    content = tomllib.loads((tmp_path / "capture.toml").read_text())
    assert content["kind"] == "target" and content["units"] == "m" and content["version"] == 1
    assert all((tmp_path / name).exists() for name in content["contains"])
    assert np.allclose(content["box_m"], scene.box_m.ravel(), atol=1e-6)
    assert load_target(tmp_path / "target.toml") == scene.target
    assert load_board(tmp_path / "photos" / "board.toml") == scene.board
    assert all(camera.R is None for camera in load_cameras(tmp_path / "photos" / "cameras.json"))
    assert load_cameras(tmp_path / "photos" / "truth_cameras.json") == scene.cameras
    assert np.allclose(
        load_transform(tmp_path / "truth_radar_from_photo.json").matrix,
        scene.radar_from_photo.matrix,
    )
    assert len(read_mesh(tmp_path / "truth.ply").triangles) == len(scene.target_mesh.triangles)


def test_photos_can_be_absent(tmp_path: Path) -> None:
    write_photos(build(scene_file(TARGET)), tmp_path)
    assert not (tmp_path / "photos").exists()
    assert "photos" not in tomllib.loads((tmp_path / "capture.toml").read_text())["contains"]
    assert Photos().cameras == 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sensor": {"sweep": []}}, "the radar measures nothing"),
        ({"depth_step_hz": 90e9}, "expected less than the highest tone"),
        (
            {"target": {"kind": "sphere", "motion": {"direction": [0, 0, 0]}}},
            "expected a direction",
        ),
        ({"target": {"kind": "calibration_target", "material": {"kind": "skin"}}}, "unknown key"),
        ({"noise": {"snr_db": -1e4}}, "greater than or equal to -200"),
        ({"target": {"kind": "sphere", "offset_m": [1e300, 0]}}, "less than or equal to 100"),
    ],
)
def test_what_cannot_be_simulated_is_refused(change: dict, message: str) -> None:
    with pytest.raises(HandbenchError, match=r"scene\.toml") as error:
        scene_file({"version": 1, "name": "s", "target": {"kind": "sphere"}} | change)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ({"kind": "sphere", "radius_m": 0.25, "distance_m": 0.1}, "behind the array's plane"),
        ({"kind": "sphere", "radius_m": 0.5, "edge_m": 1e-4, "distance_m": 1}, "triangles"),
        (
            {"kind": "plate", "width_m": 1, "height_m": 1, "edge_m": 1e-4, "distance_m": 1},
            "triangles",
        ),
    ],
)
def test_targets_that_no_scene_can_have_are_refused(target: dict, message: str) -> None:
    with pytest.raises(HandbenchError, match=message):
        build(
            scene_file(
                {"version": 1, "name": "s", "target": target, "mount": {"offset_m": [0, 0, 3]}}
            )
        )
