"""Computation of `Sight`: the complex factors by which the outlines of a body change the fields of
the antennas on a surface.

The field near an outline is smooth over points, antennas and frequency. It is therefore computed
only at samples of the surface, for few antennas of each line and for three tones, and interpolated;
no ray per facet is needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.cpu.adjoint import Sight
from handbench.radar.simulation.physics.creeping import roundness_of
from handbench.radar.simulation.physics.diffraction import (
    FARTHEST,
    cached_edges,
    cells_of,
    edge_waves,
    outline,
    visible_outline,
)
from handbench.radar.simulation.physics.facets import Facets, quarters
from handbench.radar.simulation.physics.line_of_sight import evenly_spaced, lines
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.parallel import for_each
from handbench.support.rays import Rays

NODES_M = 0.02  # between the antennas of a line for which the field is computed
SAMPLES_M = 2e-3  # longest edges of the triangles at whose corners it is
CELL = 6.0  # width of the cells of samples over that
FULL = 0.05  # smaller differences from full sight, or from none, are ignored
IN_SIGHT = np.array([1.0, 0.0, 0.0], np.complex64)[:, None]  # in a table of `Sight`


class Samples(NamedTuple):
    """Points of a surface at which the diffracted field is computed, and weights that interpolate
    between them.

    points_m [s, 3]: the points, about apart_m apart; corner [3, p]: indices of the three points
    around each of p facets; share [3, p]: the facets' barycentric coordinates between these.
    """

    points_m: np.ndarray
    corner: np.ndarray
    share: np.ndarray
    apart_m: float


def sight_of(
    scene: EchoScene,
    hiding: Body,
    samples: Samples,
    rays: Rays,
    array: AntennaArray,
    apart_m: float,
) -> tuple[Sight, np.ndarray]:
    """Compute by which complex factor the outlines of a body change the field of each antenna at
    the facets of a surface: (`Sight`, boolean mask [p] of the facets that at least one transmitter
    and one receiver reach).

    hiding: the body whose outlines diffract; samples: points of the surface, with the facets'
    weights; rays: ray caster of all obstacles; apart_m: largest distance between those antennas of
    a line for which the field is computed; for the others it is interpolated.
    """
    points_m, corner, share, _ = samples
    turns = scene.frequencies_hz / SPEED_OF_LIGHT_M_S
    edges, roundness = cached_edges(scene, hiding), roundness_of(scene, hiding)
    cells = cells_of(points_m, CELL * samples.apart_m)
    middle, half = (turns.max() + turns.min()) / 2, np.ptp(turns) / 2 + 1e-6 * turns.max()
    wavenumbers = 2 * np.pi * (middle + half * np.array([-1.0, 0.0, 1.0]))
    tables: list[np.ndarray] = []
    spreads: list[np.ndarray] = []
    some = np.ones(len(points_m), bool)
    for leg in array.legs:
        at, spread = _nodes(leg.position_m, apart_m)
        table = np.zeros((len(points_m), 3, len(at)), np.complex64)
        nodes = list(zip(table.transpose(2, 1, 0), leg.position_m[at], strict=True))

        def work(node: tuple[np.ndarray, np.ndarray]) -> None:
            factors, antenna_m = node
            part = visible_outline(outline(hiding, edges, antenna_m, roundness), rays, antenna_m)
            visible = rays.in_sight(points_m, antenna_m)
            low, middle, high = edge_waves(antenna_m, cells, part, wavenumbers)
            factors[:] = visible + middle, (high - low) / 2, (high + low) / 2 - middle

        for_each(work, nodes)
        some &= _far(table)
        tables.append(table)
        spreads.append(spread)
    partial = np.any([_far(table - IN_SIGHT) for table in tables], axis=0)
    seen_any = some[corner].any(axis=0)
    corner[:, ~partial[corner].any(axis=0)] = -1
    detour_m = 0.75 * FARTHEST / wavenumbers[-1]  # whose wave has half faded
    beside = 1 / (4 * turns.max() * apart_m)  # waves from there turn by π/2 from node to node
    sight = Sight(
        corner, share, tables[0], spreads[0], tables[1], spreads[1], middle, half, detour_m, beside
    )
    return sight, seen_any


def _far(table: np.ndarray) -> np.ndarray:
    """Return a boolean mask [s], True for points of a table [s, 3, nodes] at which some complex
    coefficient exceeds FULL in magnitude."""
    parts = table.view(np.float32).reshape(len(table), -1)
    return np.asarray(((parts[:, ::2] ** 2 + parts[:, 1::2] ** 2) > FULL**2).any(axis=1))


def _nodes(antennas_m: np.ndarray, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose antennas evenly along each line, at most apart_m apart: (their indices, weights
    float32 [a, nodes] that interpolate values at them to all antennas [a, 3] by cubic splines)."""
    chosen: list[int] = []
    spread = np.zeros((len(antennas_m), len(antennas_m)), np.float32)
    for line in lines(antennas_m):
        at, along_m = evenly_spaced(antennas_m[line], apart_m)
        weights = CubicSpline(along_m[at], np.eye(len(at)))(along_m) if len(at) > 1 else 1.0
        spread[line, len(chosen) : len(chosen) + len(at)] = weights
        chosen += line[at].tolist()
    return np.array(chosen), np.ascontiguousarray(spread[:, : len(chosen)])


def samples_of(body: Body, facets: Facets, samples_m: float = SAMPLES_M) -> Samples:
    """Choose the points of a body's surface at which the diffracted field is computed: the corners
    of its faces, which are split into four, repeatedly, until no edge is longer than samples_m.

    Each facet gets the indices of the three corners of the part that contains it, and its
    barycentric coordinates between them.
    """
    around = body.faces[facets.face]
    corners_m = body.vertices_m[around]
    share = barycentric(corners_m, facets.position_m)
    edges_m = np.sqrt(((corners_m - corners_m[:, [2, 0, 1]]) ** 2).sum(axis=2)).max(
        axis=1, initial=0
    )
    fine = edges_m.max(initial=0) <= samples_m
    while len(coarse := np.flatnonzero(edges_m > samples_m)):
        halves = share[coarse]
        # of `quarters`: 3 is the middle
        part = np.where(halves.max(axis=1) >= 0.5, halves.argmax(axis=1), 3)
        corners_m[coarse] = quarters(corners_m[coarse]).reshape(4, len(coarse), 3, 3)[
            part, np.arange(len(coarse))
        ]
        share[coarse] = barycentric(corners_m[coarse], facets.position_m[coarse])
        edges_m[coarse] /= 2
    if fine:  # the mesh's vertices
        used = np.bincount(around.ravel(), minlength=len(body.vertices_m)) > 0
        points_m, corner = body.vertices_m[used], (np.cumsum(used) - 1)[around]
    else:
        flat_m = corners_m.reshape(-1, 3)
        # shared ones
        tag = (
            flat_m[:, 0] * 0.6180339887 + flat_m[:, 1] * 1.3247179572 + flat_m[:, 2] * 2.2055694304
        )
        _, first, corner = np.unique(tag, return_index=True, return_inverse=True)
        points_m, corner = flat_m[first], corner.reshape(-1, 3)
    around, share = (
        np.ascontiguousarray(corner.T, np.int32),
        np.ascontiguousarray(share.T, np.float32),
    )
    return Samples(points_m, around, share, samples_m)


def barycentric(corners_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return the barycentric coordinates [n, 3] of points [n, 3], each in its own triangle
    (corners_m [n, 3, 3])."""
    a, b, c = (corners_m[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    square = np.einsum("ni,ni->n", normal, normal)
    u = np.einsum("ni,ni->n", np.cross(c - b, points_m - b), normal) / square
    v = np.einsum("ni,ni->n", np.cross(a - c, points_m - c), normal) / square
    return np.stack([u, v, 1 - u - v], axis=1)
