"""Photographs of a hand before a larger printed plate, through the command and without a box: the
hand is the mesh."""

import json

import numpy as np
import pytest

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.run.photogrammetry import photographs
from handbench.bench.scenes.build import build
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.mesh.surface import read_surface
from handbench.bench.studies.photogrammetry.photogrammetry_cases import Case

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene_and_photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hand")
    file = Case("small", "W", 401, cameras=6, width=800).scene_file()
    scene = build(
        file.model_copy(update={"target": file.target.model_copy(update={"edge_m": 2e-3})})
    )
    write_photos(scene, folder)
    return scene, folder / "photos"


def test_the_hand_is_found_before_the_larger_board(scene_and_photos, tmp_path, capsys):
    scene, photos = scene_and_photos
    command = ["groundtruth", str(photos), "-o", str(tmp_path / "mesh.ply"), "--dense", "cpu"]
    assert main([*command, "--workdir", str(tmp_path / "work")]) == 0
    said, summary = (
        capsys.readouterr().err,
        json.loads((tmp_path / "work" / "summary.json").read_text()),
    )
    assert "target: " in said and "volume (" in said and " s of processor time and " in said
    assert (
        summary["options"]["components"] == "target"
        and summary["target"]["kept"] == "what stands off the board"
    )
    assert (
        summary["volume"]["source"].startswith("the board") and len(summary["volume"]["box_m"]) == 6
    )
    box_m = np.reshape(summary["volume"]["box_m"], (2, 3))
    assert (box_m[0] < scene.box_m[0]).all() and (box_m[1] > scene.box_m[1]).all()
    # What matching takes time for: surroundings that are no more than the plate's, and a cloud of
    # what stands off it.
    assert np.prod(np.diff(box_m, axis=0)) < 100 * np.prod(
        np.diff(scene.box_m, axis=0)
    )  # measured: 48
    assert summary["points"] < 200_000  # measured: 77 000

    surface = read_surface(tmp_path / "mesh.ply")
    assert (
        surface.vertices_m[:, 2].min() > 0.002
    )  # nothing of the plate, which is three times as large
    points_m = surface.vertices_m[surface.observed]
    points_m = points_m[((points_m > scene.box_m[0]) & (points_m < scene.box_m[1])).all(axis=1)]
    distance_m = raycasting_scene(scene.target_mesh).compute_distance(
        scene.radar_from_photo.points(points_m).astype(np.float32)
    )
    assert len(points_m) > 2000 and np.median(distance_m.numpy()) < 0.5e-3
    assert (
        np.ptp(points_m, axis=0)[1] > 0.8 * np.ptp(scene.box_m, axis=0)[1]
    )  # from the wrist to the fingertips


def test_a_run_reconstructs_as_the_command_does(scene_and_photos, tmp_path):
    _, photos = scene_and_photos
    (photos.parent / "capture.toml").write_text('version = 1\nname = "hand"\n')
    _, options = photographs(photos.parent, "normal", 0)
    assert options.components == "target" and options.box_m is None
