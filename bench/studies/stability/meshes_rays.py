"""Rays that meet a mesh exactly at its vertices and edges, obliquely, from far away, or on their own surface."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import Delaunay

from bench.studies.stability.cases import Seen, Works, case, refusal
from bench.studies.stability.meshes_shapes import DEPTH_M, ball, between, depth, on_plane, sheet
from radar.support.rays import Rays

EYES_M = np.array([[0.07, 0.07, 0.0], [-0.3, 0.2, 0.3], [0.0, 0.0, 20.0]])


@case("meshes", "rays through vertices and edges", "rays", 0.0)
def _watertight() -> Seen:
    """Rays that slip through a closed sheet. Against: none. Because: the ray caster's edge tests are watertight:
    neighbours share each edge's sign."""
    for n, half_m in product((7, 30, 128), (0.1, 0.13)):
        corners = np.linspace(-half_m, half_m, n + 1)[1:-1]  # the rim belongs to the sheet only in part
        slipped = (np.isnan(depth(*sheet(n, half_m), axis, axis)).sum() for axis in (corners, between(n, half_m)))
        yield f"{n} × {n} squares of {2e3 * half_m / n:.3g} mm", sum(slipped)
    generator = np.random.default_rng(0)
    rim = [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]
    places = np.concatenate([generator.uniform(-0.1, 0.1, (200, 2)), rim])
    faces = Delaunay(places).simplices
    edges = places[faces[:, :2]]
    along = generator.uniform(0, 1, (len(edges), 1))
    met = np.concatenate([places[:-4], edges[:, 0] + along * (edges[:, 1] - edges[:, 0])])
    yield "an uneven triangulation", np.isnan(depth(on_plane(places), faces, *met.T).diagonal()).sum()


def _slipped(rings: int, aims: np.ndarray, eye_m: np.ndarray) -> float:
    """Share of the rays from an eye to places on a ball that face it which go on to the far side."""
    vertices, faces = ball(rings)
    towards = aims - eye_m
    facing = np.einsum("ni,ni->n", towards, aims - [0, 0, DEPTH_M]) < -0.1 * 0.05 * np.linalg.norm(towards, axis=1)
    along, _ = Rays(vertices, faces).first_hits(np.tile(eye_m, (len(aims), 1)), towards)
    return float((along[facing] > 1 + 1e-3).mean())


@case("meshes", "oblique rays onto a closed ball", "1", 1.0)
def _oblique() -> Seen:
    """Share of rays that slip through, over that of rays within rounding of an edge. Against: none. Because: an oblique
    ray's edge tests round by 2⁻²² of its way: as many rays as pass an edge within that may slip."""
    for rings, eye_m in product((16, 60), EYES_M):
        vertices, faces = ball(rings)
        generator = np.random.default_rng(3)
        chosen = faces[generator.integers(0, len(faces), 100_000)]
        aims = np.einsum("nk,nkj->nj", generator.dirichlet([1, 1, 1], len(chosen)), vertices[chosen])
        edges_per_m = 3 / (np.pi * 0.05 / rings)  # length of edges over the area
        rounded = edges_per_m * 2.0**-22 * np.linalg.norm(eye_m - [0, 0, DEPTH_M])
        yield f"{rings} rings, from {eye_m.tolist()} m", _slipped(rings, aims, eye_m) / rounded


@case("meshes", "oblique rays exactly through vertices and edges", "1", 0.25)
def _at_edges() -> Seen:
    """Share of rays that slip through. Against: none. Because: single precision decides for each of the two faces at an
    edge by itself whether the ray meets it: both say no in at most a quarter of the cases; rays along z, which depth
    maps are made of, do not slip at all."""
    for rings, eye_m in product((8, 24, 60), EYES_M):
        vertices, faces = ball(rings)
        aims = np.concatenate([vertices, vertices[faces[:, :2]].mean(axis=1)])
        yield f"{rings} rings, from {eye_m.tolist()} m", _slipped(rings, aims, eye_m)


@case("meshes", "points on their own surface", "points", 0.0)
def _own_surface() -> Seen:
    """Points that hide themselves, or shine through. Against: n·(eye − p) of a ball. Because: rays start 0.2 mm above
    the surface, many times single precision's step up to 500 m, where meshes end; points seen within 0.1 rad of grazing
    are not asked."""
    for range_m in (0.1, 0.3, 2.0, 20.0, 400.0):
        vertices, faces = ball(40, 0.05, (0, 0, range_m))
        corners = vertices[faces]
        areal = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0
        points = corners[areal].mean(axis=1)
        outward, towards = points - [0, 0, range_m], -points
        lengths_m2 = np.linalg.norm(outward, axis=1) * np.linalg.norm(towards, axis=1)
        cosine = np.einsum("ni,ni->n", outward, towards) / lengths_m2
        wrong = Rays(vertices, faces).in_sight(points, np.zeros(3)) != (cosine > 0)
        yield f"range {range_m:g} m", wrong[np.abs(cosine) > 0.1].sum()


@refusal("meshes", "a scene beyond single precision", "single precision")
def _far_scene() -> Works:
    """Half a kilometre away a surface and what hides it round to one place."""
    vertices, faces = sheet(10)
    yield "600 m away", lambda: Rays(vertices + 600, faces)
