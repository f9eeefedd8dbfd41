"""A reconstruction against the true scene: error, completeness, scale, and the honesty of its error
bars."""

from __future__ import annotations

import numpy as np

from handbench.bench.evaluation.metrics import BAND
from handbench.bench.scenes.build import Scene
from handbench.bench.tradeoff.groundtruth import radar_side
from handbench.calibration.transforms import umeyama
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.mesh.mesh_files import raycasting_scene
from handbench.groundtruth.pipeline import ReconstructedMesh
from tests.bench.studies.columns import Record

COMPLETE_M = 1e-3
WITHIN = {"within_1_sigma": 1.0, "within_2_sigma": 2.0, "within_95": BAND}  # standard deviations
SCALED = 500  # points that the scale is told from


def score(result: ReconstructedMesh, scene: Scene) -> Record:
    """The result, whose frame is the photographs', against its scene: distances of the mesh's
    observed vertices to the true surface; and the shares of them whose distance is inside so many
    of their own standard deviations."""
    surface = result.surface
    points_m = scene.radar_from_photo.points(surface.vertices_m)[surface.observed]
    signed = (
        raycasting_scene(scene.target_mesh)
        .compute_signed_distance(points_m.astype(np.float32))
        .numpy()
    )
    signed_m = signed.astype(np.float64)
    distance_m = np.abs(signed_m)
    x_m, y_m, z_m = radar_side(scene.target_mesh, scene.radar_from_photo, scene.box_m)
    side_m = np.stack([*np.meshgrid(x_m, y_m), z_m], axis=-1)[np.isfinite(z_m)]
    ratio = distance_m / surface.sigma_m[surface.observed]
    true = {camera.name: camera for camera in scene.cameras}
    off_m = [
        np.linalg.norm(camera.centre_m - true[camera.name].centre_m) for camera in result.cameras
    ]
    return {
        "median_m": float(np.median(distance_m)),
        "signed_m": float(np.median(signed_m)),
        "rms_m": float(np.sqrt(np.mean(distance_m**2))),
        "p95_m": float(np.quantile(distance_m, 0.95)),
        "max_m": float(distance_m.max()),
        "complete": completeness(points_m, side_m),
        "scale": scale_error(scene.radar_from_photo.inverse().points(side_m), result.cameras, true),
        "centre_m": float(np.mean(off_m)),
        **{name: float(np.mean(ratio <= k)) for name, k in WITHIN.items()},
    }


def completeness(points_m: np.ndarray, side_m: np.ndarray) -> float:
    """Share of the points side_m [n, 3] that are within a millimetre of one of points_m [m, 3]."""
    from scipy.spatial import KDTree

    return float(
        np.mean(KDTree(points_m).query(side_m, distance_upper_bound=COMPLETE_M)[0] <= COMPLETE_M)
    )


def scale_error(points_m: np.ndarray, ours: tuple[Camera, ...], true: dict[str, Camera]) -> float:
    """Relative error of the scale: points [n, 3] in the photo frame, photographed by the true
    cameras and triangulated by ours, come out larger by so much."""
    points_m = points_m[:: max(1, len(points_m) // SCALED)]
    normal, right = np.zeros((len(points_m), 3, 3)), np.zeros((len(points_m), 3))
    for camera in ours:
        xy = np.asarray(camera.colmap().cam_from_img(true[camera.name].project(points_m)))
        rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ camera.rotation
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]  # the nearest point to all rays
        normal += across
        right += across @ camera.centre_m
    found_m = np.linalg.solve(normal, right[..., None])[..., 0]
    return float(np.cbrt(np.linalg.det(umeyama(points_m, found_m, with_scale=True)[:3, :3])) - 1)
