"""The ray caster of a body, and the choice of few antennas of each line."""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.scene import Body, EchoScene
from handbench.support.rays import Rays


def rays_of(scene: EchoScene, body: Body) -> Rays:
    """Return the ray caster of a body's mesh, built once per scene."""
    return scene.cached(("rays", id(body)), lambda: Rays(body.vertices_m, body.faces))


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
