"""The posed hand as tests look at it: its signed distance in the hand frame, and its soundness."""

import numpy as np

from handbench.bench.scenes.bones import hand_from_palm, skeleton
from handbench.bench.scenes.hand import hand_mesh, palm_field
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.implicit import Field
from handbench.bench.scenes.people import MEAN, Person


def hand_field(pose: Pose, person: Person = MEAN) -> Field:
    """Signed distance (approximately, exact sign) to the posed hand's skin, metres, in the hand
    frame."""
    field, turn = palm_field(pose, person), hand_from_palm(pose)
    return lambda points: field(points @ turn)


def one_body(pose: Pose, edge_m: float, person: Person = MEAN) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of the hand's mesh, which is closed, of one piece, on the skin and around
    all joints."""
    surface = hand_mesh(pose, edge_m, person)
    vertices_m, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    assert surface.is_edge_manifold(allow_boundary_edges=False) and surface.is_vertex_manifold()
    assert len(surface.cluster_connected_triangles()[1]) == 1
    field = hand_field(pose, person)
    assert np.abs(field(vertices_m)).max() < 1e-5
    digits = skeleton(pose, person).values()
    joints_m = np.array([p for digit in digits for b in digit for p in (b.start_m, b.end_m)])
    assert field(joints_m).max() < -5e-4
    return vertices_m, faces
