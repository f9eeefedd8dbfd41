"""The metric scale from distances between cameras that somebody measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from groundtruth.cameras.cameras import registered
from groundtruth.options import Distance
from groundtruth.sparse.frame import Scale
from radar.support.errors import HandbenchError

if TYPE_CHECKING:
    import pycolmap

DISAGREEMENT = 0.02  # largest share by which a distance may miss the fit


def distances_from_model(model: pycolmap.Reconstruction, distances: tuple[Distance, ...]) -> tuple[np.ndarray, Scale]:
    """4×4 similarity that scales the reconstruction to metres and leaves its frame, by least squares over distances
    between projection centres; the residual is that of the distances (None for one alone, which nothing checks).

    A HandbenchError when a photograph is not registered or a distance misses the fit by more than 2 %.
    """
    centre = {image.name: image.projection_center() for image in registered(model)}
    for distance in distances:
        for name in (distance.first, distance.second):
            if name not in centre:
                raise HandbenchError(
                    f"--distance: {name} is not among the registered photographs ({', '.join(centre)}); name two of "
                    "them"
                )
    length = np.array([np.linalg.norm(centre[d.first] - centre[d.second]) for d in distances])
    known_m = np.array([d.distance_m for d in distances])
    if not length.all():
        raise HandbenchError("--distance: two photographs were taken from the same point; measure between two others")
    scale = float(length @ known_m / (length @ length))
    off_m = scale * length - known_m
    worst = int(np.argmax(np.abs(off_m) / known_m))
    if abs(off_m[worst]) > DISAGREEMENT * known_m[worst]:
        d = distances[worst]
        raise HandbenchError(
            f"--distance: {d.first} to {d.second} is given as {d.distance_m} m, all together make it "
            f"{scale * length[worst]:.4g} m; they must agree to {DISAGREEMENT:.0%}: measure between the lenses' "
            "entrance pupils, and check the names"
        )
    residual_m = float(np.sqrt(np.mean(off_m**2))) if len(distances) > 1 else None
    return np.diag([scale, scale, scale, 1.0]), Scale("distances", len(distances), len(distances), residual_m)
