"""A reconstructed mesh against the true surface: error, completeness, and the honesty of its error bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.scenes.scene import Scene
from calibration.meshes import raycasting_scene
from calibration.transforms import umeyama
from groundtruth.depth import depth_on_grid
from groundtruth.pipeline import Result

if TYPE_CHECKING:
    import open3d as o3d

GRID_M = 5e-4  # of the rays from the radar's side that sample the true surface
COMPLETE_M = 1e-3
BAND = 1.96  # standard deviations of the 95 % band
SCALED, ICP_STEPS = 20_000, 30  # points that the scale is told from, and steps to it


@dataclass(frozen=True)
class Score:
    """Distances of the mesh's observed vertices to the true surface, metres; complete: share of the radar-side surface
    that lies within 1 mm of them; scale: relative error of the mesh's size; within_1_sigma, within_2_sigma, within_95:
    share of the vertices whose distance is inside so many of their own standard deviations."""

    median_m: float
    rms_m: float
    p95_m: float
    max_m: float
    complete: float
    scale: float
    within_1_sigma: float
    within_2_sigma: float
    within_95: float


def score(result: Result, scene: Scene) -> Score:
    """The result, whose frame is the photographs', against its scene."""
    surface = result.surface
    points_m = scene.radar_from_photo.points(surface.vertices_m)[surface.observed]
    truth = raycasting_scene(scene.target_mesh)
    distance_m = truth.compute_distance(points_m.astype(np.float32)).numpy().astype(np.float64)
    ratio = distance_m / surface.sigma_m[surface.observed]
    return Score(
        float(np.median(distance_m)), float(np.sqrt(np.mean(distance_m**2))), float(np.quantile(distance_m, 0.95)),
        float(distance_m.max()), completeness(points_m, scene), scale_error(points_m, truth),
        *(float(np.mean(ratio <= k)) for k in (1.0, 2.0, BAND)),
    )


def completeness(points_m: np.ndarray, scene: Scene) -> float:
    """Share of the true surface [·] that the radar's side shows, above the crop box's floor, near points [n, 3]."""
    from scipy.spatial import KDTree

    side_m = radar_side(scene.target_mesh)
    in_photo_m = scene.radar_from_photo.inverse().points(side_m)
    side_m = side_m[((in_photo_m >= scene.box_m[0]) & (in_photo_m <= scene.box_m[1])).all(axis=1)]
    return float(np.mean(KDTree(points_m).query(side_m, distance_upper_bound=COMPLETE_M)[0] <= COMPLETE_M))


def radar_side(surface: o3d.geometry.TriangleMesh) -> np.ndarray:
    """Points [n, 3] of a surface where rays along +z meet it first, one per cell of a grid."""
    vertices = np.asarray(surface.vertices)
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    x_m, y_m = (np.arange(a, b, GRID_M) for a, b in zip(low, high, strict=True))
    z_m = depth_on_grid(surface, x_m, y_m)
    return np.stack([*np.meshgrid(x_m, y_m), z_m], axis=-1)[np.isfinite(z_m)]


def scale_error(points_m: np.ndarray, truth: o3d.t.geometry.RaycastingScene) -> float:
    """Relative error of the scale of points [n, 3] that lie close to a surface: a similarity to their nearest points on
    it, again and again (ICP)."""
    points_m = points_m[:: max(1, len(points_m) // SCALED)]
    matrix = np.eye(4)
    for _ in range(ICP_STEPS):
        moved = points_m @ matrix[:3, :3].T + matrix[:3, 3]
        nearest = truth.compute_closest_points(moved.astype(np.float32))["points"].numpy().astype(np.float64)
        matrix = umeyama(moved, nearest, with_scale=True) @ matrix
    return float(1 / np.cbrt(np.linalg.det(matrix[:3, :3])) - 1)
