"""The posed hand as tests look at it: its signed distance in the hand frame, what its mesh's facets
cut and which angles they make."""

import numpy as np

from handbench.bench.scenes.bones import hand_from_palm
from handbench.bench.scenes.hand import palm_field
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.implicit import Field
from handbench.bench.scenes.people import MEAN, Person


def hand_field(pose: Pose, person: Person = MEAN) -> Field:
    """Signed distance (approximately, exact sign) to the posed hand's skin, metres, in the hand
    frame."""
    field, turn = palm_field(pose, person), hand_from_palm(pose)
    return lambda points: field(points @ turn)


def crossing_faces(vertices_m: np.ndarray, faces: np.ndarray) -> int:
    """The number of triangles that cut another one (open3d's own test compares all with all)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices_m, faces))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def facet_angles(vertices_m: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each edge of a closed mesh the angle [e] between the normals of its two facets, degrees,
    and its ends [e, 2]."""
    corners = vertices_m[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    first, second = order[::2], order[1::2]  # in a closed mesh every edge has two facets
    # The arc sine of half the chord keeps small angles exact.
    chord = np.linalg.norm(normals[first // 3] - normals[second // 3], axis=1)
    return 2 * np.degrees(np.arcsin(np.minimum(chord / 2, 1))), edges[first]
