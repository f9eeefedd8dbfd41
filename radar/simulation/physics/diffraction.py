"""Diffraction at the outlines of a body: how much of an antenna's field reaches a point behind or beside it.

Kirchhoff's integral over an opaque screen before a spherical wave, as an integral along the screen's outline (Maggi,
Rubinowicz; Miyamoto & Wolf, J. Opt. Soc. Am. 52 (1962) 615). At small angles, with δ the detour by way of the outline
and φ its angle around the ray from antenna to point,

    D = V + (1/2π) Σ_edges ∫ e^{−jkδ} dφ,

where V is 1 in sight and 0 in the shadow. The jump of V where the ray crosses the outline is that of ∫dφ by 2π: D is
smooth there, ½ beside a straight edge, which gives ½ erfc(√(jkδ)) in the shadow: Fresnel's knife edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from radar.imaging.cpu.steering import FAST
from radar.simulation.physics.facets import face_vectors
from radar.simulation.scene import Body

FARTHEST = 40.0  # kδ beyond which an edge is left out; its wave fades from half of that on
NEAREST_M = 1e-3  # between an outline and a point behind it: closer ones belong to the point's own horizon


class Edges(NamedTuple):
    """Inner edges of a body: ends [e, 2] of vertices, in the order in which the first of both faces [e, 2] has them."""

    ends: np.ndarray
    faces: np.ndarray


def edges_of(faces: np.ndarray) -> Edges:
    """The edges of a closed mesh's faces [m, 3]."""
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    order = np.lexsort(np.sort(directed, axis=1).T)
    one, other = order[::2], order[1::2]  # in a closed mesh every edge has two faces
    return Edges(directed[one], np.stack([one, other], axis=1) // 3)


def outline(body: Body, edges: Edges, antenna_m: np.ndarray) -> np.ndarray:
    """The edges [n, 2, 3] between a face that an antenna sees from the front and one that it sees from behind, in the
    front face's order: counter-clockwise around what hides, as the antenna sees it."""
    corners_m = body.vertices_m[body.faces[:, 0]]
    front = (face_vectors(body.vertices_m, body.faces) * (antenna_m - corners_m)).sum(axis=1) > 0
    first, second = front[edges.faces].T
    ends = np.concatenate([edges.ends[first & ~second], edges.ends[second & ~first][:, ::-1]])
    return body.vertices_m[ends]


@numba.njit(**FAST)
def edge_waves(antenna_m, points_m, outline_m, wavenumbers):  # type: ignore[no-untyped-def]
    """(1/2π) Σ ∫ e^{−jkδ} dφ at points_m [n, 3] for each wavenumber [k]: complex128 [k, n]. What an edge turns of the
    phase from one end to the other fades it."""
    waves = np.zeros((len(wavenumbers), len(points_m)), np.complex128)
    for i in range(len(points_m)):
        wx, wy, wz = points_m[i, 0] - antenna_m[0], points_m[i, 1] - antenna_m[1], points_m[i, 2] - antenna_m[2]
        way = np.sqrt(wx * wx + wy * wy + wz * wz)
        dx, dy, dz = wx / way, wy / way, wz / way
        scale = 1 / np.sqrt(dx * dx + dz * dz)  # two axes across the ray, e = d × y and f = d × e
        ex, ez = -dz * scale, dx * scale
        fx, fy, fz = dy * ez, dz * ex - dx * ez, -dy * ex
        for s in range(len(outline_m)):
            px, py, pz = (
                outline_m[s, 0, 0] - antenna_m[0],
                outline_m[s, 0, 1] - antenna_m[1],
                outline_m[s, 0, 2] - antenna_m[2],
            )
            qx, qy, qz = (
                outline_m[s, 1, 0] - antenna_m[0],
                outline_m[s, 1, 1] - antenna_m[1],
                outline_m[s, 1, 2] - antenna_m[2],
            )
            before = (dx * (px + qx) + dy * (py + qy) + dz * (pz + qz)) / 2
            behind = way - before
            if behind < NEAREST_M or before <= 0:
                continue
            ux, uy = ex * px + ez * pz, fx * px + fy * py + fz * pz
            vx, vy = ex * qx + ez * qz, fx * qx + fy * qy + fz * qz
            mx, my = (ux + vx) / 2, (uy + vy) / 2
            square = mx * mx + my * my
            detour = np.sqrt(before * before + square) + np.sqrt(behind * behind + square) - way
            if detour * wavenumbers[0] > FARTHEST:
                continue
            rise = abs(vx * vx + vy * vy - ux * ux - uy * uy) * way / (4 * before * behind)
            angle = np.arctan2(vx * uy - vy * ux, ux * vx + uy * vy) / (2 * np.pi)
            for n in range(len(wavenumbers)):
                turned, phase = rise * wavenumbers[n], detour * wavenumbers[n]
                fade = 1.0 if turned < 1e-3 else np.sin(turned) / turned
                if 2 * phase > FARTHEST:
                    fade *= 0.5 + 0.5 * np.cos(np.pi * min(2 * phase / FARTHEST - 1, 1.0))
                waves[n, i] += angle * fade * np.exp(-1j * phase)
    return waves
