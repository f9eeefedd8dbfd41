"""Triangle meshes: areas, normals, their division, and whether one is a plate or a box."""

import numpy as np

from handbench.radar.simulation.scene import Body

MOST_FACETS = 4_000_000  # of a surface
SIDES = 6  # of a plate or box, at most
ALIKE, FLAT_M = 1e-3, 1e-5  # of the faces of one side: difference of unit normals, and of planes


def face_vectors(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the outward normal of each face times its area: [m, 3], m²."""
    a, b, c = (vertices_m[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a) / 2


def convex_block(body: Body) -> bool:
    """Return True for a plate or a box, a convex body of at most six flat sides: all its vertices
    are behind the plane of each side."""
    normals = unit(face_vectors(body.vertices_m, body.faces))
    vertices_m = body.vertices_m - body.vertices_m.mean(axis=0)
    offsets_m = (normals * vertices_m[body.faces[:, 0]]).sum(axis=1)
    planes = np.column_stack([normals, offsets_m])
    for _ in range(SIDES):
        if len(planes) == 0:
            break
        side = planes[0]
        if (vertices_m @ side[:3] > side[3] + FLAT_M).any():
            return False
        planes = planes[(np.abs(planes - side) > (ALIKE, ALIKE, ALIKE, FLAT_M)).any(axis=1)]
    return len(planes) == 0


def vertex_normals(body: Body) -> np.ndarray:
    """Return the unit normal at each vertex [n, 3]: the mean normal of the faces around it,
    weighted by their areas."""
    normals = np.zeros_like(body.vertices_m)
    vectors = face_vectors(body.vertices_m, body.faces)
    for corner in range(3):
        for axis in range(3):
            normals[:, axis] += np.bincount(body.faces[:, corner], vectors[:, axis], len(normals))
    return unit(normals)


def quarters(corners: np.ndarray) -> np.ndarray:
    """Split triangles [m, 3, 3] each into four at its edges' midpoints: [4·m, 3, 3]."""
    a, b, c = (corners[:, i] for i in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )


def unit(vectors: np.ndarray) -> np.ndarray:
    """Scale vectors [..., 3] to length 1; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)
