"""The target as eight cameras would reconstruct it: points on the spheres that they see, with errors like theirs."""

import numpy as np

from bench.scenes.rig import rig
from bench.studies.registration.cases import Case

DENSITY_M2 = 2e6  # points on a square metre of foam: 2 per mm²
NOISE_M, PATCH_NOISE_M, PATCH_M = 3e-5, 1.5e-5, 3e-3  # of each point, and common to patches; measured on hands
NORMAL_NOISE = 0.07  # per axis: 4°
STEEPEST = 0.35  # cosine at which a camera sees too little of a surface
CAMERAS = 8


def seen_cloud(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 3] (metres, photo frame) and outward normals [n, 3] that two cameras or more see, behind no other
    sphere, and the plate's."""
    scene, target = case.scene, case.scene.target
    rng = np.random.default_rng([case.number, 8])
    aim_m = np.array([0.0, 0.0, scene.file.target.distance_m])
    cameras = rig(CAMERAS, 2400, 1600, aim_m, scene.radar_from_photo, scene.file.seed)
    photo_from_radar = scene.radar_from_photo.inverse()
    centres_m = photo_from_radar.points(scene.radar_from_target.points(target.centres_m))[list(case.seen)]
    radii_m = np.array([target.element[i].sphere_radius_m for i in case.seen])
    eyes_m = np.array([camera.centre_m for camera in cameras])
    points, normals = [], []
    for centre_m, radius_m in zip(centres_m, radii_m, strict=True):
        outward = rng.standard_normal((int(4 * np.pi * radius_m**2 * DENSITY_M2), 3))
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        on_it = centre_m + radius_m * outward
        views = sum(_sees(eye_m, on_it, outward, centres_m, radii_m) for eye_m in eyes_m)
        outward, on_it = outward[views >= 2], on_it[views >= 2]
        error_m = NOISE_M * rng.standard_normal(len(on_it)) + _patches(on_it, rng)
        points.append(on_it + error_m[:, None] * outward)
        normals.append(outward)
    plate_m = rng.uniform((-0.2, -0.15, 0), (0.2, 0.15, 0), (100_000, 3))
    plate_m += (0, 0, NOISE_M) * rng.standard_normal(plate_m.shape)
    p, n = np.concatenate([*points, plate_m]), np.concatenate([*normals, np.tile([0.0, 0, 1], (len(plate_m), 1))])
    return p, n + NORMAL_NOISE * rng.standard_normal(n.shape)


def _sees(
    eye_m: np.ndarray, points_m: np.ndarray, outward: np.ndarray, centres_m: np.ndarray, radii_m: np.ndarray
) -> np.ndarray:
    """True where a camera sees each point [n] of a sphere: not too steeply, and past all spheres."""
    ray = points_m - eye_m
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    ray /= length
    free = np.einsum("nk,nk->n", -ray, outward) > STEEPEST
    for centre_m, radius_m in zip(centres_m, radii_m, strict=True):
        along = (centre_m - eye_m) @ ray.T
        beside_m = np.linalg.norm(eye_m + along[:, None] * ray - centre_m, axis=1)
        free &= ~((beside_m < radius_m) & (along < length[:, 0] - 2 * radius_m))
    return free


def _patches(points_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Errors [n] that neighbours share."""
    cells = np.unique(np.floor(points_m / PATCH_M), axis=0, return_inverse=True)[1].ravel()
    return PATCH_NOISE_M * rng.standard_normal(cells.max(initial=0) + 1)[cells]
