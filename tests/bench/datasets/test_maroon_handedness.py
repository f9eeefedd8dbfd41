"""The hand of MAROON's radar frame: read from the matrix, decided by a surface, and without
influence on the scores.

The reference is the same capture written otherwise: with another radar frame, or with points that
are mirror images.
"""

import json
import re
import shutil

import numpy as np
import pytest

from handbench.bench.datasets.dataset import import_capture, open_capture
from handbench.bench.datasets.maroon_alignment import handedness_of
from handbench.bench.pipeline.score import reference_of_file
from handbench.cli.main import main
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import PixelGrid
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import PLACE_M, TONES_HZ, patch_m, plane_m
from tests.bench.datasets.maroon_writer import write_maroon

BENCH = """version = 1
name = "hand"
[[capture]]
path = "patch/30"
[[method]]
id = "2fsk"
[[method]]
id = "kinect"
"""
GRID = PixelGrid(np.linspace(-0.039, -0.021, 9), np.linspace(0.011, 0.029, 9))


@pytest.fixture(scope="module")
def written(native, maroon):
    """One capture with a mirrored and a plain radar frame; its box lies to one side of x = 0."""
    return {True: maroon, False: write_maroon(native, native.parent / "plain", mirrored=False)}


@pytest.fixture(params=[True, False], ids=["mirrored", "plain"])
def hand(request, written, tmp_path):
    """A copy of either, to spoil, and its hand."""
    folder = tmp_path / "maroon" / "patch" / "30"
    return shutil.copytree(written[request.param], folder), request.param


@pytest.mark.slow
def test_the_scores_do_not_depend_on_the_frame(written, tmp_path):
    """As a black box."""
    tables = []
    for mirrored, folder in written.items():
        bench, out = tmp_path / f"{mirrored}" / "bench.toml", tmp_path / f"{mirrored}" / "out"
        shutil.copytree(folder.parents[1], bench.parent)
        bench.write_text(BENCH)
        assert main(["run", str(bench), "-o", str(out)]) == 0
        lines = (out / "table.csv").read_text().splitlines()
        tables.append([line for line in lines if "second" not in line])
        notes = json.loads((out / "result.json").read_text())["facts"]["transform_notes"]
        assert f"has {'a' if mirrored else 'no'} reflection" in json.dumps(notes)
    assert tables[0] == tables[1] and any("kinect" in line for line in tables[0])


def lies_on_the_plane(capture):
    found = reference_of_file(capture.mesh(), capture.transform(), GRID).z_m
    np.testing.assert_allclose(found, np.broadcast_to(plane_m(GRID.x_m), (9, 9)), atol=1e-8)


def test_the_run_says_by_how_much_the_mirror_image_is_further_off(hand, capsys):
    folder, mirrored = hand
    transform = open_capture(folder).transform()
    written = capsys.readouterr().err
    assert written.count("mirrored") == 1  # once a process
    assert transform.note is not None and transform.note in written
    gain_mm = float(transform.note.split("surface is ")[1].split(" mm further off")[0])
    assert 35 < gain_mm < 65  # the image lies 60 mm beside the patch, which is 20 mm wide
    assert transform.scale == pytest.approx(1)
    assert ("negated" in transform.note) == mirrored
    lies_on_the_plane(open_capture(folder))


def test_points_that_are_mirror_images_are_noticed(hand, tmp_path):
    """The matrix then suggests the other frame; the surface knows better, and boxes and depths stay
    what they were."""
    folder, mirrored = hand
    before, mesh = open_capture(folder).about.methods, folder / "photogrammetry/mesh_masked.obj"
    mesh.write_text(mesh.read_text().replace("v -0.0", "v 0.0"))
    calib = json.loads((folder / "alignment.json").read_text())
    flipped = np.array(calib["photogrammetry2radar"]) @ np.diag([-1.0, 1, 1, 1])
    calib["photogrammetry2radar"] = flipped.tolist()
    (folder / "alignment.json").write_text(json.dumps(calib))
    capture = open_capture(folder)
    assert capture.handedness.mirrored == mirrored
    assert "nearer to" in capture.handedness.note
    assert capture.transform().scale == pytest.approx(-1)
    assert capture.about.methods == before
    lies_on_the_plane(capture)
    with pytest.raises(HandbenchError, match="cannot record"):
        import_capture("maroon", folder, tmp_path / "native")


def test_another_sensor_decides_where_there_is_no_mesh_and_the_matrix_without_it(hand):
    folder, mirrored = hand
    for gone, words in (
        ("photogrammetry", "kinect2radar.*further off"),
        ("kinect", "nothing to check it by"),
    ):
        shutil.rmtree(folder / gone)
        found = open_capture(folder).handedness
        assert found.mirrored == mirrored and re.search(words, found.note)


def test_an_object_that_is_its_own_mirror_image_leaves_it_to_the_matrix(hand):
    folder, mirrored = hand
    half_m = patch_m() - [PLACE_M[0], 0, 0]
    points = Scatterers(np.concatenate([half_m, half_m * [-1, 1, 1]]), np.ones(50))
    samples = simulate(points, TONES_HZ, qar50())[None].astype(np.complex64)
    corners_m = np.array(
        [(x, y, 0.29 + 0.1 * abs(x)) for y in (0.01, 0.03) for x in (-0.01, 0, 0.01)]
    )
    surface = corners_m, np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]])
    echoes = RadarCapture(samples, TONES_HZ, qar50())
    found = handedness_of(
        folder / "alignment.json", "photogrammetry", lambda: surface, lambda: echoes
    )
    assert found.mirrored == mirrored and "further off" in found.note
