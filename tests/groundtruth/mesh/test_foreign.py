"""Meshes of others, carried to metres."""

import json

import numpy as np

from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import read_mesh

VERTICES_MM = np.array([(10, 20, 300), (90, 20, 310), (10, 180, 290), (90, 180, 305)], dtype=float)
FACES = np.array([(0, 1, 2), (2, 1, 3)])


def test_the_command_takes_a_mesh_over(tmp_path, capsys):
    rows = [f"v {x} {y} {z}\n" for x, y, z in VERTICES_MM] + [
        f"f {a} {b} {c}\n" for a, b, c in FACES + 1
    ]
    (tmp_path / "hand.obj").write_text("".join(rows))
    command = ["groundtruth", str(tmp_path / "hand.obj"), "-o", str(tmp_path / "out.ply")]
    assert main(command) == 2
    assert "--unit: is missing" in capsys.readouterr().err
    assert main([*command, "--unit", "mm"]) == 0
    assert json.loads(capsys.readouterr().out) == {"vertices": 4, "triangles": 2}
    np.testing.assert_allclose(
        np.asarray(read_mesh(tmp_path / "out.ply").vertices), VERTICES_MM / 1000, atol=1e-8
    )
    assert main([*command, "--unit", "mm"]) == 2
    assert "exists already" in capsys.readouterr().err
    command[1] = str(tmp_path)
    assert main([*command, "--unit", "mm", "--overwrite"]) == 2
    assert "--unit: is only for a mesh file" in capsys.readouterr().err
