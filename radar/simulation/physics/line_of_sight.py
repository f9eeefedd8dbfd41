"""Line of sight between antennas and points, and the choice of few antennas of each line."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.rays import Rays

# distance of the first antennas: the shadow of an object 2 mm wide, a tenth of the range before the
# skin
STRIDE_M = 0.02


def rays_of(scene: EchoScene, body: Body) -> Rays:
    """Return the ray caster of a body's mesh, built once per scene."""
    return scene.cached(("rays", id(body)), lambda: Rays(body.vertices_m, body.faces))


def points_in_sight(
    rays: Rays, points_m: np.ndarray, antennas_m: np.ndarray, stride_m: float = STRIDE_M
) -> np.ndarray:
    """Return a boolean mask [a, n], True for the points that have a clear line of sight to each
    antenna.

    Antennas about stride_m apart are tested first; where two neighbours of these agree, those
    between them are assumed to agree.
    """
    clear = np.empty((len(antennas_m), len(points_m)), bool)
    for line in lines(antennas_m):
        step_m = np.linalg.norm(np.diff(antennas_m[line], axis=0), axis=1).max(initial=0)
        stride = max(1, int(stride_m / step_m)) if step_m > 0 else 1
        first = [*range(0, len(line) - 1, stride), len(line) - 1]
        for n in first:
            clear[line[n]] = rays.in_sight(points_m, antennas_m[line[n]])
        for start, stop in pairwise(first):
            before, behind = clear[line[start]], clear[line[stop]]
            differ = np.flatnonzero(before != behind)
            for antenna in line[start + 1 : stop]:
                clear[antenna] = before
                clear[antenna, differ] = rays.in_sight(points_m[differ], antennas_m[antenna])
    return clear


def lines(antennas_m: np.ndarray) -> list[np.ndarray]:
    """Divide antennas [a, 3] into straight lines: a list of arrays of successive indices. A new
    line begins where the distance to the antenna before is more than twice the median distance."""
    if len(antennas_m) < 2:
        return [np.arange(len(antennas_m))]
    steps_m = np.linalg.norm(np.diff(antennas_m, axis=0), axis=1)
    return np.split(
        np.arange(len(antennas_m)), 1 + np.flatnonzero(steps_m > 2 * np.median(steps_m))
    )


def evenly_spaced(line_m: np.ndarray, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose evenly spaced antennas of one line [a, 3], at most apart_m apart, including both ends:
    (their indices, distance of each of the line's antennas from its start [a] in metres)."""
    along_m = np.concatenate([[0.0], np.linalg.norm(np.diff(line_m, axis=0), axis=1).cumsum()])
    count = min(len(line_m), 1 + int(np.ceil(along_m[-1] / apart_m)))
    return np.linspace(0, len(line_m) - 1, count).round().astype(int), along_m


def nodes(antennas_m: np.ndarray, apart_m: float) -> np.ndarray:
    """Choose antennas evenly along each line of the antennas [a, 3], about apart_m apart, including
    the lines' ends: their indices."""
    return np.concatenate(
        [line[evenly_spaced(antennas_m[line], apart_m)[0]] for line in lines(antennas_m)]
    )
