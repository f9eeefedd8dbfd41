"""What tells how smooth a mesh is: angles and crossings of known bodies, the radar's change under a
known shift."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.bench.scenes.bones import skeleton
from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES
from handbench.groundtruth.mesh.mesh_files import load_open3d
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from tests.bench.scenes.hand_field import hand_field
from tests.bench.scenes.hand_smoothness import (
    TONES_HZ,
    crossing_faces,
    facet_angles,
    parts_at,
    radar_change,
    subdivided,
)


def test_angles_of_a_box() -> None:
    box = load_open3d().geometry.TriangleMesh.create_box()
    angles_deg, ends = facet_angles(np.asarray(box.vertices), np.asarray(box.triangles))
    assert sorted(angles_deg) == pytest.approx(
        [0] * 6 + [90] * 12
    )  # the faces' diagonals and the box's edges
    lengths = np.linalg.norm(np.diff(np.asarray(box.vertices)[ends], axis=1)[:, 0], axis=1)
    assert lengths[angles_deg > 45] == pytest.approx(1)


def crossing_facets(surface) -> int:
    return crossing_faces(np.asarray(surface.vertices), np.asarray(surface.triangles))


def test_crossing_facets_are_found() -> None:
    sphere = load_open3d().geometry.TriangleMesh.create_sphere(1.0)
    assert crossing_facets(sphere) == 0
    assert (
        crossing_facets(
            sphere + load_open3d().geometry.TriangleMesh(sphere).translate((0.5, 0.1, 0.0))
        )
        > 20
    )


def test_subdivision_lies_on_the_hand() -> None:
    coarse = hand_mesh(POSES["B"], 4e-3)
    finer = subdivided(coarse, POSES["B"])
    assert len(finer.triangles) == 4 * len(coarse.triangles)
    assert np.abs(hand_field(POSES["B"])(np.asarray(finer.vertices))).max() < 1e-5
    flat = coarse.subdivide_midpoint(1)
    assert np.abs(hand_field(POSES["B"])(np.asarray(flat.vertices))).max() > 1e-4


def test_a_shift_changes_echoes_and_depths_by_what_it_should() -> None:
    ball = load_open3d().geometry.TriangleMesh.create_sphere(0.02, resolution=60)
    shift_m = 2e-5
    moved = load_open3d().geometry.TriangleMesh(ball).translate((0.0, 0.0, shift_m))
    echo_change, depth_change_m = radar_change(ball, moved)
    assert echo_change == pytest.approx(
        4 * np.pi * shift_m * TONES_HZ.mean() / SPEED_OF_LIGHT_M_S, rel=0.05
    )
    assert depth_change_m == pytest.approx(shift_m, rel=0.1)
    assert radar_change(ball, ball) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_parts_are_named() -> None:
    tip_m = skeleton(POSES["B"])["index"][3].end_m
    assert parts_at(POSES["B"], tip_m).startswith("index 3 / ")
    assert "palm" in parts_at(POSES["B"], np.zeros(3))
