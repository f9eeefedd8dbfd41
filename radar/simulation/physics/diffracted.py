"""The share of each antenna's field that reaches the facets of a body past outlines: `Sight`.

The field beside an outline is smooth from point to point, from antenna to antenna and in frequency. It is computed at
samples of the surface, for few antennas of each line and three tones, and interpolated; there is no ray per facet.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.imaging.cpu.ascent import Sight
from radar.simulation.physics.diffraction import FARTHEST, cells_of, edge_waves, kept_edges, outline, seen_outline
from radar.simulation.physics.facets import Facets, quarters
from radar.simulation.physics.line_of_sight import lines
from radar.simulation.scene import Body, EchoScene
from radar.support.parallel import for_each
from radar.support.rays import Rays

NODES_M = 0.02  # between the antennas of a line for which the field is computed
SAMPLES_M = 2e-3  # edges of the triangles at whose corners it is
FULL = 0.05  # difference from full sight, or from none, that does not count
IN_SIGHT = np.array([1.0, 0.0, 0.0])[:, None]  # in a table of `Sight`


def sight_of(
    scene: EchoScene, surface: Body, facets: Facets, hiding: Body, rays: Rays, array: AntennaArray
) -> tuple[Sight, np.ndarray]:
    """The sight of a surface's facets behind a body, and the mask [p] of those of which some transmitter and some
    receiver see anything. rays: against all that hides."""
    points_m, corner, share = _samples(surface, facets)
    edges, cells = kept_edges(scene, hiding), cells_of(points_m)
    turns_per_m = scene.frequencies_hz / SPEED_OF_LIGHT_M_S
    middle, half = (turns_per_m.max() + turns_per_m.min()) / 2, np.ptp(turns_per_m) / 2 + 1e-6 * turns_per_m.max()
    wavenumbers = 2 * np.pi * (middle + half * np.array([-1.0, 0.0, 1.0]))

    def table_of(antennas_m: np.ndarray) -> np.ndarray:
        table = np.empty((len(points_m), 3, len(antennas_m)), np.complex64)

        def work(i: int) -> None:
            seen = seen_outline(outline(hiding, edges, antennas_m[i]), rays, antennas_m[i])
            low, middle, high = edge_waves(antennas_m[i], cells, seen, wavenumbers) + rays.in_sight(
                points_m, antennas_m[i]
            )
            table[:, 0, i], table[:, 1, i], table[:, 2, i] = middle, (high - low) / 2, (high + low) / 2 - middle

        for_each(work, range(len(antennas_m)))
        return table

    (at_tx, spread_tx), (at_rx, spread_rx) = (nodes_of(leg.position_m, NODES_M) for leg in array.legs)
    tables = table_of(array.tx_m[at_tx]), table_of(array.rx_m[at_rx])
    partial, some = np.zeros(len(points_m), bool), np.ones(len(points_m), bool)
    for table in tables:
        partial |= (np.abs(table - IN_SIGHT) > FULL).any(axis=(1, 2))
        some &= (np.abs(table) > FULL).any(axis=(1, 2))
    seen = some[corner].any(axis=0)
    corner[:, ~partial[corner].any(axis=0)] = -1
    legs = tables[0], spread_tx, tables[1], spread_rx
    return Sight(corner, share, *legs, middle, half, detour_m(turns_per_m)), seen


def detour_m(turns_per_m: np.ndarray) -> float:
    """The detour whose wave has faded by half."""
    return float(0.75 * FARTHEST / (2 * np.pi * np.max(turns_per_m)))


def nodes_of(antennas_m: np.ndarray, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of antennas [a, 3] up to apart_m apart along each line, and weights [a, nodes] by which all follow."""
    chosen, parts = [], []
    for line in lines(antennas_m):
        along_m = np.concatenate([[0], np.linalg.norm(np.diff(antennas_m[line], axis=0), axis=1).cumsum()])
        count = min(len(line), 2 + int(along_m[-1] / apart_m))
        at = np.unique(np.linspace(0, len(line) - 1, count).round().astype(int))
        weights = CubicSpline(along_m[at], np.eye(len(at)))(along_m) if len(at) > 1 else np.ones((len(line), 1))
        chosen.append(line[at])
        parts.append((line, weights))
    spread = np.zeros((len(antennas_m), sum(map(len, chosen))), np.float32)
    start = 0
    for line, weights in parts:
        spread[line, start : start + weights.shape[1]] = weights
        start += weights.shape[1]
    return np.concatenate(chosen), spread


def _samples(body: Body, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [s, 3] of a body's surface, three of them around each facet: corner [3, p], and the share [3, p] of each.

    The faces, each split in four until its edges are short; a facet's barycentric coordinates lead it to its part."""
    corners_m = body.vertices_m[body.faces[facets.face]]
    share = _barycentric(corners_m, facets.position_m)
    edges_m = np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max(axis=1, initial=0)
    for _ in range(int(np.ceil(np.log2(max(edges_m.max(initial=0) / SAMPLES_M, 1))))):
        coarse = np.flatnonzero(edges_m > SAMPLES_M)
        halves = share[coarse]
        part = np.where(
            halves.max(axis=1) >= 0.5, halves.argmax(axis=1), 3
        )  # of `quarters`: at a corner, or the middle
        quartered_m = quarters(corners_m[coarse]).reshape(4, len(coarse), 3, 3)
        corners_m[coarse] = quartered_m[part, np.arange(len(coarse))]
        share[coarse] = _barycentric(corners_m[coarse], facets.position_m[coarse])
        edges_m[coarse] /= 2
    flat_m = corners_m.reshape(-1, 3)
    tag = flat_m[:, 0] * 0.6180339887 + flat_m[:, 1] * 1.3247179572 + flat_m[:, 2] * 2.2055694304
    _, first, corner = np.unique(tag, return_index=True, return_inverse=True)
    return flat_m[first], corner.reshape(-1, 3).T.astype(np.int32), np.ascontiguousarray(share.T, np.float32)


def _barycentric(corners_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Coordinates [n, 3] of points [n, 3] in triangles [n, 3, 3]."""
    a, b, c = (corners_m[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    square = np.einsum("ni,ni->n", normal, normal)
    u = np.einsum("ni,ni->n", np.cross(c - b, points_m - b), normal) / square
    v = np.einsum("ni,ni->n", np.cross(a - c, points_m - c), normal) / square
    return np.stack([u, v, 1 - u - v], axis=1)
