"""Rays that meet a mesh exactly at its vertices and edges, obliquely, from far away, or on their own surface."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from bench.studies.stability.cases import Refused, Worst, case, refused, worst
from bench.studies.stability.meshes_shapes import DEPTH_M, ball, depth, on_plane, refusal, sheet
from radar.support.rays import Rays

EYES_M = np.array([[0.07, 0.07, 0.0], [-0.3, 0.2, 0.3], [0.0, 0.0, 20.0]])


@case(
    "meshes",
    "rays through vertices and edges",
    quantity="rays that slip through a closed sheet",
    reference="none",
    unit="rays",
    bound=0.0,
    reason="the ray caster's edge tests are watertight: neighbours share each edge's sign",
)
def _watertight() -> Worst:
    def slipped(cells: int, half_m: float) -> int:
        corners = np.linspace(-half_m, half_m, cells + 1)[1:-1]  # the rim belongs to the sheet only in part
        between = np.convolve(np.linspace(-half_m, half_m, cells + 1), [0.5, 0.5], "valid")
        mesh = sheet(cells, half_m)
        return sum(int(np.isnan(depth(*mesh, axis, axis)).sum()) for axis in (corners, between))

    seen = [
        (f"{n} × {n} squares of {2e3 * half_m / n:.3g} mm", slipped(n, half_m))
        for n in (7, 30, 128)
        for half_m in (0.1, 0.13)
    ]
    generator = np.random.default_rng(0)
    rim = [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]
    places = np.concatenate([generator.uniform(-0.1, 0.1, (200, 2)), rim])
    faces = Delaunay(places).simplices
    edges = places[faces[:, :2]]
    along = generator.uniform(0, 1, (len(edges), 1))
    met = np.concatenate([places[:-4], edges[:, 0] + along * (edges[:, 1] - edges[:, 0])])
    missed = np.isnan(depth(on_plane(places), faces, *met.T).diagonal())
    return worst([*seen, ("an uneven triangulation", int(missed.sum()))])


def _slipped(rings: int, aims: np.ndarray, eye_m: np.ndarray) -> float:
    """Share of the rays from an eye to places on a ball that face it which go on to the far side."""
    vertices, faces = ball(rings)
    towards = aims - eye_m
    facing = np.einsum("ni,ni->n", towards, aims - [0, 0, DEPTH_M]) < -0.1 * 0.05 * np.linalg.norm(towards, axis=1)
    along, _ = Rays(vertices, faces).first_hits(np.tile(eye_m, (len(aims), 1)), towards)
    return float((along[facing] > 1 + 1e-3).mean())


@case(
    "meshes",
    "oblique rays onto a closed ball",
    quantity="share of rays that slip through, over that of rays within rounding of an edge",
    reference="none",
    unit="1",
    bound=1.0,
    reason="an oblique ray's edge tests round by 2⁻²² of its way: as many rays as pass an edge within that may slip",
)
def _oblique() -> Worst:
    def share(rings: int, eye_m: np.ndarray) -> float:
        vertices, faces = ball(rings)
        generator = np.random.default_rng(3)
        chosen = faces[generator.integers(0, len(faces), 100_000)]
        aims = np.einsum("nk,nkj->nj", generator.dirichlet([1, 1, 1], len(chosen)), vertices[chosen])
        edges_per_m = 3 / (np.pi * 0.05 / rings)  # length of edges over the area
        return _slipped(rings, aims, eye_m) / (edges_per_m * 2.0**-22 * np.linalg.norm(eye_m - [0, 0, DEPTH_M]))

    return worst((f"{n} rings, from {eye_m.tolist()} m", share(n, eye_m)) for n in (16, 60) for eye_m in EYES_M)


@case(
    "meshes",
    "oblique rays exactly through vertices and edges",
    quantity="share of rays that slip through",
    reference="none",
    unit="1",
    bound=0.25,
    reason="single precision decides for each of the two faces at an edge by itself whether the ray meets it: both say "
    "no in at most a quarter of the cases; rays along z, which depth maps are made of, do not slip at all",
)
def _at_edges() -> Worst:
    def share(rings: int, eye_m: np.ndarray) -> float:
        vertices, faces = ball(rings)
        return _slipped(rings, np.concatenate([vertices, vertices[faces[:, :2]].mean(axis=1)]), eye_m)

    return worst((f"{n} rings, from {eye_m.tolist()} m", share(n, eye_m)) for n in (8, 24, 60) for eye_m in EYES_M)


@case(
    "meshes",
    "points on their own surface",
    quantity="points that hide themselves, or shine through",
    unit="points",
    reference="n·(eye − p) of a ball",
    bound=0.0,
    reason="rays start 0.2 mm above the surface, many times single precision's step up to 500 m, where meshes end; "
    "points seen within 0.1 rad of grazing are not asked",
)
def _own_surface() -> Worst:
    def wrong(range_m: float) -> int:
        vertices, faces = ball(40, 0.05, (0, 0, range_m))
        corners = vertices[faces]
        areal = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
        points = corners[areal].mean(axis=1)
        eye = np.zeros(3)
        outward = (points - [0, 0, range_m]) / np.linalg.norm(points - [0, 0, range_m], axis=1, keepdims=True)
        towards = (eye - points) / np.linalg.norm(eye - points, axis=1, keepdims=True)
        cosine = np.einsum("ni,ni->n", outward, towards)
        seen = Rays(vertices, faces).in_sight(points, eye)
        return int((seen != (cosine > 0))[np.abs(cosine) > 0.1].sum())

    return worst((f"range {range_m:g} m", wrong(range_m)) for range_m in (0.1, 0.3, 2.0, 20.0, 400.0))


@refusal("a scene beyond single precision", "half a kilometre away a surface and what hides it round to one place")
def _far_scene() -> Refused | Worst:
    vertices, faces = sheet(10)
    return refused(lambda: Rays(vertices + 600, faces), "single precision")
