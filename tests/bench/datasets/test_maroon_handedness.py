"""The hand of MAROON's radar frame: read from the matrix, decided by a surface, and without
influence on the scores.

The reference is the same capture written otherwise: with another radar frame, or with points that
are mirror images.
"""

import json
import shutil

import numpy as np
import pytest

from handbench.bench.datasets.dataset import import_capture, open_capture
from handbench.bench.datasets.maroon_alignment import handedness_of
from handbench.bench.pipeline.score import reference_of_file
from handbench.cli.main import main
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import (
    AXES,
    PLACE_M,
    TONES_HZ,
    echoes,
    patch_m,
    write_native,
)
from tests.bench.datasets.maroon_writer import write_maroon

BENCH = """version = 1
name = "hand"
[[capture]]
path = "patch/30"
[[method]]
id = "2fsk"
[[method]]
id = "kinect"
[[method]]
id = "broadband"
config = { start_hz = 72e9, stop_hz = 82e9, count = 5 }
"""
FRAMES = {True: "mirrored", False: "plain"}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """One capture with a mirrored and a plain radar frame; its box lies to one side of x = 0."""
    folder = tmp_path_factory.mktemp("hands")
    native = write_native(folder / "native", echoes(1))
    return {
        mirrored: write_maroon(native, folder / name, mirrored=mirrored, kinect=True)
        for mirrored, name in FRAMES.items()
    }


@pytest.fixture(params=[True, False], ids=FRAMES.get)
def mine(request, written, tmp_path):
    """A copy of either, to spoil, and its hand."""
    return shutil.copytree(
        written[request.param], tmp_path / "maroon" / "patch" / "30"
    ), request.param


def mirror(file, folder) -> None:
    """Replace a mesh by its mirror image, and its matrix by the one that carries this to the same
    place."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    lines = [line.split() for line in file.read_text().splitlines()]
    words = [[w[0], str(-float(w[1])), *w[2:]] if w[0] == "v" else w for w in lines]
    file.write_text("\n".join(map(" ".join, words)))
    calib = json.loads((folder / "alignment.json").read_text())
    calib["photogrammetry2radar"] = (np.array(calib["photogrammetry2radar"]) @ flip).tolist()
    (folder / "alignment.json").write_text(json.dumps(calib))


def depth_of(capture):
    grid = PixelGrid(np.linspace(-0.039, -0.021, 9), np.linspace(0.011, 0.029, 9))
    return reference_of_file(capture.mesh(), capture.transform(), grid).z_m


def expected():
    x_m = np.linspace(-0.039, -0.021, 9)
    return np.broadcast_to(PLACE_M[2] + 0.2 * (x_m - PLACE_M[0]), (9, 9))


def test_the_scores_do_not_depend_on_the_frame(written, tmp_path, capsys):
    """As black boxes: `handbench run`, then `handbench evaluate` of a map that `handbench
    reconstruct` made."""
    tables, scores = [], []
    for mirrored, folder in written.items():
        bench = folder.parents[1] / "bench.toml"
        bench.write_text(BENCH)
        out = tmp_path / FRAMES[mirrored]
        assert main(["run", str(bench), "-o", str(out)]) == 0
        tables.append((out / "table.csv").read_text())
        facts = json.loads((out / "result.json").read_text())
        assert ("has a reflection" if mirrored else "has no reflection") in json.dumps(
            facts["facts"]["transform_notes"]
        )
        depth = tmp_path / f"{FRAMES[mirrored]}.npz"
        assert main(["reconstruct", str(folder), "--method", "2fsk", "-o", str(depth)]) == 0
        capsys.readouterr()
        mesh = folder / "photogrammetry" / "mesh_masked.obj"
        assert (
            main(
                [
                    "evaluate",
                    str(depth),
                    "--mesh",
                    str(mesh),
                    "--transform",
                    str(folder / "alignment.json"),
                ]
            )
            == 0
        )
        scores.append(json.loads(capsys.readouterr().out))
    assert "kinect" in tables[0]
    assert without_time(tables[0]) == without_time(tables[1])
    assert scores[0] == scores[1] and scores[0]["n_observed"] > 0


def without_time(table: str) -> list[str]:
    """Lines of a table but those of seconds and memory."""
    return [
        line
        for line in table.splitlines()
        if "second" not in line and ",s," not in line and ",MB," not in line
    ]


def test_the_run_says_by_how_much_the_mirror_image_is_further_off(mine, capsys):
    folder, mirrored = mine
    transform = open_capture(folder).transform()
    said = capsys.readouterr().err
    assert said.count("mirrored") == 1  # once a process
    assert transform.note is not None and transform.note in said
    gain_mm = float(transform.note.split("lies ")[1].split(" mm further off")[0])
    assert 35 < gain_mm < 65  # the image lies 60 mm beside the patch, which is 20 mm wide
    assert transform.scale == pytest.approx(1)
    assert ("negated" in transform.note) == mirrored
    np.testing.assert_allclose(depth_of(open_capture(folder)), expected(), atol=1e-8)


def test_points_that_are_mirror_images_are_noticed(mine, tmp_path):
    """The matrix then suggests the other frame; the surface knows better, and boxes and depths stay
    what they were."""
    folder, mirrored = mine
    before = open_capture(folder).about.methods
    mirror(folder / "photogrammetry" / "mesh_masked.obj", folder)
    capture = open_capture(folder)
    assert capture.handedness.mirrored == mirrored
    assert "nearer to" in capture.handedness.note
    assert capture.transform().scale == pytest.approx(-1)
    assert capture.about.methods == before
    np.testing.assert_allclose(depth_of(capture), expected(), atol=1e-8)
    with pytest.raises(HandbenchError, match="no place for that"):
        import_capture("maroon", folder, tmp_path / "native")


def test_another_sensor_decides_where_there_is_no_mesh(mine):
    folder, mirrored = mine
    shutil.rmtree(folder / "photogrammetry")
    found = open_capture(folder).handedness
    assert (
        found.mirrored == mirrored
        and found.note.startswith("kinect2radar")
        and "further off" in found.note
    )


def test_without_a_surface_the_matrix_decides(mine):
    folder, mirrored = mine
    shutil.rmtree(folder / "photogrammetry")
    shutil.rmtree(folder / "kinect")
    found = open_capture(folder).handedness
    assert found.mirrored == mirrored and "nothing to check it by" in found.note


def test_an_object_that_is_its_own_mirror_image_leaves_it_to_the_matrix(mine):
    folder, mirrored = mine
    points_m = np.concatenate(
        [patch_m() - [PLACE_M[0], 0, 0], (patch_m() - [PLACE_M[0], 0, 0]) * [-1, 1, 1]]
    )
    samples = simulate(Scatterers(points_m, np.ones(50)), TONES_HZ, qar50())[None]
    corners_m = np.array(
        [[x, y, 0.29 + 0.1 * abs(x)] for y in (0.01, 0.03) for x in (-0.01, 0, 0.01)]
    )
    faces = np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]])
    found = handedness_of(
        folder / "alignment.json",
        "photogrammetry",
        lambda: (corners_m, faces),
        lambda: RadarCapture(samples.astype(np.complex64), TONES_HZ, qar50()),
    )
    assert found.mirrored == mirrored and "further off" in found.note


def test_echoes_that_cannot_be_imaged_leave_it_to_the_matrix(mine):
    folder, mirrored = mine

    def none() -> RadarCapture:
        return RadarCapture(np.ones((1, 2, 94, 94), np.complex64), np.array([72e9, 73e9]), qar50())

    found = handedness_of(
        folder / "alignment.json", "photogrammetry", lambda: (np.eye(3), np.eye(3, dtype=int)), none
    )
    assert found.mirrored == mirrored and "not checked" in found.note


def test_bounds_follow_the_frame(mine):
    folder, mirrored = mine
    metadata = json.loads((folder / "metadata.json").read_text())
    edge = -PLACE_M[0] if mirrored else PLACE_M[0]
    metadata["mask_bb"] |= {
        "xmin" if mirrored else "xmax": float(edge)
    }  # the side that is our x below the patch's middle
    (folder / "metadata.json").write_text(json.dumps(metadata))
    x_m = np.linspace(AXES["x"]["start_m"], AXES["x"]["stop_m"], 11)
    kept = open_capture(folder).mask(
        DepthMap(x_m, np.array([0.02]), np.full((1, 11), 0.29), np.zeros((1, 11)), "test")
    )
    np.testing.assert_array_equal(kept[0], x_m <= PLACE_M[0] + 1e-12)
