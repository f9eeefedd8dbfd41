"""The parametric hand: a sound mesh on the true surface, of a hand's size and in the pose asked for."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.scenes.hand import hand_field, hand_mesh
from bench.scenes.implicit import triangle_quality
from bench.scenes.poses import POSES, FingerPose, Pose
from bench.scenes.skeleton import DISTAL, FINGERS, HAND_AXES, LENGTHS_MM, PALMAR, skeleton

if TYPE_CHECKING:
    import open3d as o3d

COARSE_M = 2e-3
WRIST_M = -0.050  # the wrist's crease, where anthropometry starts to measure


@pytest.fixture(scope="module")
def fine() -> o3d.geometry.TriangleMesh:
    return hand_mesh(POSES["B"])


@pytest.fixture(scope="module")
def coarse() -> dict[str, o3d.geometry.TriangleMesh]:
    return {name: hand_mesh(pose, COARSE_M) for name, pose in POSES.items()} | {"open": hand_mesh(Pose(), COARSE_M)}


def self_intersections(surface: o3d.geometry.TriangleMesh) -> int:
    """Triangles that cut another one (open3d's own test compares all with all)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.asarray(surface.vertices), np.asarray(surface.triangles)))
    meshes.compute_selection_by_self_intersections_per_face()
    return meshes.current_mesh().selected_face_number()


def test_mesh_is_sound(fine: o3d.geometry.TriangleMesh) -> None:
    assert fine.is_edge_manifold(allow_boundary_edges=False)
    assert fine.is_vertex_manifold()
    assert self_intersections(fine) == 0
    assert len(fine.cluster_connected_triangles()[1]) == 1
    triangles = np.asarray(fine.vertices)[np.asarray(fine.triangles)]
    volume = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    assert 2.6e-4 < volume < 4.5e-4  # with its 38 mm of forearm; positive: outward-oriented


def test_triangles_are_small_and_well_shaped(fine: o3d.geometry.TriangleMesh) -> None:
    triangles = np.asarray(fine.vertices)[np.asarray(fine.triangles)]
    edges_m = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    assert edges_m.mean() == pytest.approx(1e-3, rel=0.05)
    assert edges_m.max() < 2e-3
    quality = triangle_quality(triangles)
    assert np.percentile(quality, 1) > 0.75
    assert quality.min() > 0.2


def test_vertices_lie_on_the_surface(fine: o3d.geometry.TriangleMesh) -> None:
    assert np.abs(hand_field(POSES["B"])(np.asarray(fine.vertices))).max() < 1e-5


def test_size_is_a_hands(coarse: dict[str, o3d.geometry.TriangleMesh]) -> None:
    vertices = np.asarray(coarse["open"].vertices)
    assert 0.170 < vertices[:, 1].max() - WRIST_M < 0.200
    knuckles = vertices[(np.abs(vertices[:, 1] - 0.040) < 0.005) & (vertices[:, 0] > -0.045)]  # without the thumb
    assert 0.075 < np.ptp(knuckles[:, 0]) < 0.090
    assert 0.022 < np.ptp(knuckles[:, 2]) < 0.035
    wrist = vertices[np.abs(vertices[:, 1] - WRIST_M) < 0.004]
    assert 0.055 < np.ptp(wrist[:, 0]) < 0.072


def test_the_palm_faces_the_radar_and_the_thumb_is_a_right_hands(
    coarse: dict[str, o3d.geometry.TriangleMesh],
) -> None:
    vertices = np.asarray(coarse["open"].vertices)
    assert vertices[:, 0].min() < -0.06 and vertices[:, 0].max() < 0.055  # the thumb's side is -x
    assert vertices[:, 2].min() < -0.04 and vertices[:, 2].max() < 0.02  # the thumb leans out of the palm, to -z


@pytest.mark.parametrize("name", POSES)
def test_letters_are_one_body_that_fits_the_scene(name: str, coarse: dict[str, o3d.geometry.TriangleMesh]) -> None:
    surface = coarse[name]
    assert surface.is_edge_manifold(allow_boundary_edges=False)
    assert len(surface.cluster_connected_triangles()[1]) == 1
    assert np.abs(hand_field(POSES[name])(np.asarray(surface.vertices))).max() < 1e-5
    assert surface.get_max_bound()[2] - surface.get_min_bound()[2] < 0.080  # depth of the radar's volume


def test_letters_raise_the_right_fingers() -> None:
    raised = {"B": FINGERS, "F": ("middle", "ring", "little"), "U": ("index", "middle")}
    for letter, fingers in raised.items():
        bones = skeleton(POSES[letter])
        for name in FINGERS:
            straight = bones[name][-1].axis @ bones[name][1].axis > 0.9 and bones[name][1].axis @ DISTAL > 0.9
            assert straight == (name in fingers), (letter, name)


def test_f_closes_a_ring(coarse: dict[str, o3d.geometry.TriangleMesh]) -> None:
    bones = skeleton(POSES["F"])
    tips = [bones[name][-1].end_m for name in ("index", "thumb")]
    assert np.linalg.norm(tips[0] - tips[1]) < 0.020  # two fingertips' radii and some
    genus = 1 - coarse["F"].euler_poincare_characteristic() / 2
    assert genus == 1


def test_bones_keep_their_lengths_and_bend_to_the_palm() -> None:
    pose = Pose(index=FingerPose(mcp_deg=90))
    for name, bones in skeleton(pose).items():
        assert [bone.length_m for bone in bones] == pytest.approx(1e-3 * np.array(LENGTHS_MM[name]))
        for inner, outer in itertools.pairwise(bones):
            assert outer.start_m == pytest.approx(inner.end_m)
    assert skeleton(pose)["index"][1].axis @ PALMAR > 0.99
    assert np.linalg.det(HAND_AXES) == pytest.approx(1.0)


def test_poses_differ(coarse: dict[str, o3d.geometry.TriangleMesh]) -> None:
    boxes = [np.r_[m.get_min_bound(), m.get_max_bound()] for m in coarse.values()]
    for i, box in enumerate(boxes):
        for other in boxes[:i]:
            assert np.abs(box - other).max() > 5e-3
