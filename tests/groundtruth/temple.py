"""Sixteen photographs of 640 × 480 around a temple: thin columns, all alike, before a black
background."""

import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates

from handbench.groundtruth.cameras.cameras import save_cameras
from handbench.groundtruth.mesh.mesh_files import load_open3d, raycasting_scene
from tests.groundtruth.room import true_camera

SIZE, FOCAL_PX, VIEWS = (640, 480), 1150.0, 16
DISTANCE_M, ELEVATIONS_RAD = 1.0, (0.10, 0.35)
COLUMN_M, STEP_M = 0.012, 0.07  # radius of a column, distance to the next
TEXEL_M, TEXELS = 1.5e-3, 64
SAMPLES = 2  # rays a pixel, each way


def temple():
    """The surface, metres, z upwards: about 0.36 × 0.22 × 0.28 m, 0.5 m across."""
    shapes = load_open3d().geometry.TriangleMesh
    parts = []

    def box(width, depth, height, bottom):
        parts.append(
            shapes.create_box(width, depth, height).translate((-width / 2, -depth / 2, bottom))
        )

    box(0.36, 0.22, 0.02, -0.14)
    box(0.34, 0.20, 0.02, -0.12)
    box(0.34, 0.20, 0.03, 0.08)
    box(0.30, 0.16, 0.03, 0.11)
    for i in range(5):
        for side in (-1, 1):
            column = shapes.create_cylinder(COLUMN_M, 0.18, resolution=48, split=12)
            parts.append(column.translate(((i - 2) * STEP_M, side * 0.07, -0.01)))
    mesh = parts[0]
    for part in parts[1:]:
        mesh += part
    return mesh


def albedo(points_m):
    """Solid marble [n]: two layers of noise, and one that repeats from column to column."""
    random = np.random.default_rng(3)
    repeated = points_m.copy()
    repeated[:, 0] = (repeated[:, 0] + 10 * STEP_M) % STEP_M
    value = np.full(len(points_m), 0.5)
    for at_m, scale, share in ((points_m, 1.0, 0.10), (points_m, 4.0, 0.10), (repeated, 2.0, 0.10)):
        cells = random.normal(size=(TEXELS, TEXELS, TEXELS))
        value += share * map_coordinates(
            cells, (at_m / (scale * TEXEL_M)).T, order=1, mode="grid-wrap"
        )
    return value.clip(0.05, 1)


def ring():
    """The true cameras, evenly about the temple, by turns lower and higher."""
    width, height = SIZE
    cameras = []
    for k, angle in enumerate(2 * np.pi * np.arange(VIEWS) / VIEWS):
        up = ELEVATIONS_RAD[k % 2]
        centre = DISTANCE_M * np.array(
            (np.cos(angle) * np.cos(up), np.sin(angle) * np.cos(up), np.sin(up))
        )
        params = (FOCAL_PX, FOCAL_PX, width / 2, height / 2)
        cameras.append(true_camera(f"t{k:02d}.png", centre, params, SIZE))
    return tuple(cameras)


def photograph(folder, views=range(VIEWS)):
    """Write t00.png …, of some views alone, and cameras.json with K, R and t; returns the true
    surface and the cameras."""
    mesh, cameras = temple(), tuple(ring()[view] for view in views)
    scene = raycasting_scene(mesh)
    for camera in cameras:
        Image.fromarray(_picture(scene, camera)).save(folder / camera.name)
    save_cameras(folder / "cameras.json", cameras)
    return mesh, cameras


def _picture(scene, camera):
    width, height = SAMPLES * camera.width, SAMPLES * camera.height
    u, v = np.meshgrid((np.arange(width) + 0.5) / SAMPLES, (np.arange(height) + 0.5) / SAMPLES)
    fx, fy, cx, cy = camera.params
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], axis=-1) @ camera.rotation
    origins = np.broadcast_to(camera.centre_m, rays.shape)
    hits = scene.cast_rays(
        load_open3d().core.Tensor(np.concatenate([origins, rays], axis=-1).astype(np.float32))
    )
    reach, normals = hits["t_hit"].numpy(), hits["primitive_normals"].numpy()
    seen = np.isfinite(reach)
    points_m = (origins + reach[..., None].astype(float) * rays)[seen]
    light = np.array((0.5, 0.3, 0.8)) / np.linalg.norm((0.5, 0.3, 0.8))
    picture = np.full((height, width), 0.02)
    picture[seen] = albedo(points_m) * (0.55 + 0.45 * np.abs(normals[seen] @ light))
    picture = picture.reshape(camera.height, SAMPLES, camera.width, SAMPLES).mean(axis=(1, 3))
    noise = np.random.default_rng(int(camera.name[1:3])).normal(0, 0.008, picture.shape)
    return ((picture + noise).clip(0, 1) * 255).round().astype(np.uint8)


def completeness(mesh, cameras, found, within_m, box_m):
    """Share of the true surface in a box [2, 3] that at least three cameras see which is within
    `within_m` of a found mesh."""
    points_m = np.asarray(mesh.sample_points_uniformly(60_000).points)
    scene, points_m = (
        raycasting_scene(mesh),
        points_m[((points_m > box_m[0]) & (points_m < box_m[1])).all(axis=1)],
    )
    count = np.zeros(len(points_m), int)
    for camera in cameras:
        away = camera.centre_m - points_m
        pixels = camera.project(points_m)
        inside = ((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1)
        rays = np.concatenate([points_m + 1e-4 * away, away], axis=1).astype(np.float32)
        hidden = np.isfinite(scene.cast_rays(load_open3d().core.Tensor(rays))["t_hit"].numpy())
        count += inside & ~hidden
    points_m = points_m[count >= 3].astype(np.float32)
    return float(np.mean(raycasting_scene(found).compute_distance(points_m).numpy() <= within_m))
