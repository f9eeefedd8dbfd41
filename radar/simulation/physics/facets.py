"""The surface of a body as facets that are small against the wavelength."""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.physics.meshes import face_vectors, quarters, unit, vertex_normals
from handbench.radar.simulation.scene import Body
from handbench.support.errors import HandbenchError

MOST_FACETS = 4_000_000


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
