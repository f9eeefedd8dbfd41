"""The surface of a body as facets that are small against the wavelength, with normals and areas of
meshes."""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.scene import Body
from handbench.support.errors import HandbenchError

MOST_FACETS = 4_000_000
SIDES = 6  # of a plate or box, at most
ALIKE, FLAT_M = 1e-3, 1e-5  # of the faces of one side: difference of unit normals, and of planes


def facets_of(body: Body, longest_m: float = np.inf, faces: np.ndarray | None = None) -> Scatterers:
    """Divide faces of a body (those with the indices `faces`, or all) into facets: each face is
    split into four, repeatedly, until no edge is longer than longest_m. Normals are interpolated
    between the mesh's vertices. Raises HandbenchError for more than MOST_FACETS facets."""
    chosen = np.arange(len(body.faces)) if faces is None else faces
    corners = body.vertices_m[body.faces[chosen]]
    edges_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0)
    splits = np.ceil(np.log2(np.maximum(edges_m / longest_m, 1))).astype(int)
    if (4.0**splits).sum() > MOST_FACETS:
        raise HandbenchError(
            f"target: has a longest edge of {1e3 * edges_m.max():.1f} mm, which must be split "
            f"{splits.max()} times to sample the wavelength (edges of {1e3 * longest_m:.2g} mm) "
            f"and makes more than {MOST_FACETS} facets; remesh it with edges of equal length"
        )
    normals = vertex_normals(body)[body.faces[chosen]]
    area_m2 = np.linalg.norm(face_vectors(body.vertices_m, body.faces[chosen]), axis=1)
    every = np.unique(splits) if len(splits) else [0]
    parts = [_split(corners, normals, area_m2, chosen, splits == n, n) for n in every]
    position_m, weight, normal, face, share = map(np.concatenate, zip(*parts, strict=True))
    return Scatterers(position_m, weight, normal, None, face, share)


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


def _split(
    corners: np.ndarray,
    normals: np.ndarray,
    area_m2: np.ndarray,
    face: np.ndarray,
    chosen: np.ndarray,
    splits: int,
) -> tuple[np.ndarray, ...]:
    centres = _centres(splits)
    position = np.einsum("kc,mci->mki", centres, corners[chosen]).reshape(-1, 3)
    normal = unit(np.einsum("kc,mci->mki", centres, normals[chosen]).reshape(-1, 3))
    area = np.repeat(area_m2[chosen] / len(centres), len(centres))
    share = np.tile(centres, (len(corners[chosen]), 1))
    return position, area, normal, np.repeat(face[chosen], len(centres)), share


def _centres(splits: int) -> np.ndarray:
    """Return the barycentric coordinates [4ⁿ, 3] of the centres of the parts of a triangle that is
    split into four, n = `splits` times, at its edges' midpoints."""
    triangles = np.eye(3)[None]
    for _ in range(splits):
        triangles = quarters(triangles)
    return triangles.mean(axis=1)


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
