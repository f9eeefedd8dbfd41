"""The numbers of a depth map are checked before it is scored."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.pipeline.score import score
from handbench.cli.main import main
from handbench.groundtruth.mesh.depth import Reference
from handbench.groundtruth.mesh.mesh_files import load_open3d, write_mesh
from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError

AXIS_M = np.linspace(-0.02, 0.02, 5)
Z_M = np.full((5, 5), 0.3)
PLAIN = DepthMap(AXIS_M, AXIS_M, Z_M, np.zeros((5, 5)), "mine")


def one(value, of=Z_M):
    changed = of.copy()
    changed[2, 1] = value
    return changed


WRONG = {
    "infinite": ({"z_m": one(np.inf)}, "z_m is inf at 1 of 25 pixels"),
    "minus infinite": ({"z_m": one(-np.inf)}, "z_m is -inf at 1 of 25"),
    "beyond float32": ({"z_m": one(1e39)}, r"z_m is 1e\+39 at 1 of 25"),
    "complex": ({"z_m": Z_M + 0j}, r"z_m is complex128 \(5, 5\); expected real numbers"),
    "complex axis": ({"x_m": AXIS_M + 0j}, "x_m is complex128"),
    "NaN on the axis": ({"y_m": AXIS_M * np.array([1, 1, np.nan, 1, 1])}, "y_m is not sorted"),
    "an axis twice": ({"x_m": np.zeros(5)}, "x_m is not sorted"),
    "an axis out of order": ({"x_m": np.roll(AXIS_M, 2)}, "x_m is not sorted"),
    "a huge axis": ({"x_m": AXIS_M * 1e300}, "x_m is not sorted, or has equal or infinite values"),
    "amplitude of nothing": ({"amplitude_db": one(np.nan)}, "amplitude_db is nan at 1"),
    "negative sigma": ({"sigma_m": one(-1e-3)}, "sigma_m is -0.001 at 1"),
    "no probability": ({"p_gross": one(1.5)}, "p_gross is 1.5 at 1 .*from 0 to 1"),
}


@pytest.mark.parametrize(("changed", "words"), WRONG.values(), ids=WRONG)
def test_a_map_with_impossible_numbers_is_not_scored(tmp_path, capsys, changed, words):
    wrong = replace(PLAIN, **changed)
    with pytest.raises(HandbenchError, match=words):
        score(wrong, Reference(Z_M, np.zeros((5, 5)), None, None))
    wrong.save(tmp_path / "d.npz")
    ball(tmp_path / "ball.ply")
    arguments = [str(tmp_path / "d.npz"), "--mesh", str(tmp_path / "ball.ply")]
    for command in (["inspect", arguments[0]], ["evaluate", *arguments]):
        assert main(command) == 2
        shown = " ".join("".join(capsys.readouterr()).split())
        assert "d.npz: " in shown and words.split(" is ")[0] + " is " in shown


@pytest.mark.parametrize("turned", [np.s_[::-1], np.s_[:]], ids=["descending", "ascending"])
def test_maps_with_nothing_at_some_pixels_are_scored(turned):
    depth = replace(PLAIN, x_m=AXIS_M[turned], z_m=one(np.nan), amplitude_db=one(np.nan, 0 * Z_M))
    assert score(depth, Reference(Z_M - 1e-3, np.zeros((5, 5)), None, None)).figures[
        "mae_mm"
    ] == pytest.approx(1)


def ball(file):
    mesh = load_open3d().geometry.TriangleMesh.create_sphere(0.02, resolution=10)
    write_mesh(file, mesh.translate((0, 0, 0.3)))
