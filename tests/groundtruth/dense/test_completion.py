"""A part of the temple: thin columns, and floors that every camera sees at a low angle."""

import numpy as np
import pytest

from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.options import Options
from handbench.groundtruth.pipeline import reconstruct
from tests.groundtruth import temple

VIEWS = (14, 15, 0, 1, 2)  # those on the side of the last two columns
BOX_M = np.array(
    [[0.09, 0.0, -0.15], [0.20, 0.12, 0.15]]
)  # one of the last two columns, and what is over and under it


@pytest.mark.slow
def test_most_of_what_three_cameras_see_is_found(tmp_path):
    mesh, cameras = temple.photograph(tmp_path, VIEWS)
    found = reconstruct(
        tmp_path, Options(quality="thorough", box_m=tuple(BOX_M.ravel())), tmp_path / "work"
    ).surface
    inside_m = BOX_M + np.array([[5e-3], [-5e-3]])
    assert temple.completeness(mesh, cameras, found.mesh, 5e-4, inside_m) > 0.85
    off_m = (
        raycasting_scene(mesh)
        .compute_distance(found.vertices_m[found.observed].astype(np.float32))
        .numpy()
    )
    assert np.median(off_m) < 1e-4 and np.quantile(off_m, 0.9) < 5e-4
