"""A textured sphere before a wall, whose depth is known in closed form."""

from dataclasses import replace

import numpy as np

from handbench.groundtruth.dense.dense import choose_sources
from handbench.groundtruth.dense.fusion import fuse
from handbench.groundtruth.dense.views import View

RADIUS_M, WALL_M, DISTANCE_M = (
    0.07,
    0.05,
    0.5,
)  # the sphere about the origin, the wall behind it, the cameras before it
FOCAL_PX, SIZE = 260.0, 112
PIXEL_M = (DISTANCE_M - RADIUS_M) / FOCAL_PX  # on the surface: 1.7 mm
DISPARITY_M = (
    PIXEL_M * (DISTANCE_M - RADIUS_M) / 0.12
)  # depth per pixel of disparity, at a baseline of 14°: 5.9 mm
ANGLES = np.deg2rad([(0, 0), (0, 14), (0, -14), (13, 3), (-13, -3)])


def texture(points_m):
    """A solid texture of waves, none shorter than 4 pixels."""
    rng = np.random.default_rng(5)
    waves = rng.normal(size=(60, 3))
    waves *= 2 * np.pi / (PIXEL_M * rng.uniform(4, 20, 60) * np.linalg.norm(waves, axis=1))[:, None]
    return 0.5 + 0.06 * np.sin(points_m @ waves.T + rng.uniform(0, 2 * np.pi, 60)).sum(axis=-1)


def surface(rays, R, t):
    """Depth [h, w] and world normals [h, w, 3] of what a camera sees along its rays [h, w, 3] with
    z = 1."""
    rays, centre = rays @ R, -R.T @ t
    a, b, c = (rays**2).sum(axis=-1), rays @ centre, centre @ centre - RADIUS_M**2
    root = b**2 - a * c
    hit = root > 0
    depth_m = np.where(
        hit, (-b - np.sqrt(np.where(hit, root, 0))) / a, (WALL_M - centre[2]) / rays[..., 2]
    )
    normals = np.where(
        hit[..., None], (centre + rays * depth_m[..., None]) / RADIUS_M, (0.0, 0.0, -1.0)
    )
    return depth_m, normals


def world_points_m(view, depth_m):
    """World points [h, w, 3] at the depths [h, w] of a view."""
    return (view.rays() * depth_m[..., None] - view.t) @ view.R


def view(name, angle_x, angle_y, height=SIZE, width=SIZE):
    """A camera on a sphere about the origin, and the true depth [h, w] of what it sees."""
    forward = np.array([np.sin(angle_y), np.sin(angle_x), 1.0])
    forward /= np.linalg.norm(forward)
    right = np.cross((0, 1, 0), forward)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    t = np.array([0, 0, DISTANCE_M])
    K = np.array([[FOCAL_PX, 0, width / 2 - 0.5], [0, FOCAL_PX, height / 2 - 0.5], [0, 0, 1]])
    near_m, far_m = (np.full((height, width), z, dtype=np.float32) for z in (0.40, 0.62))
    bare = View(name, np.zeros((height, width), np.float32), K, R, t, near_m, far_m)
    depth_m, _ = surface(bare.rays(), R, t)
    gray = texture(world_points_m(bare, depth_m)).astype(np.float32)
    return replace(bare, gray=gray), depth_m


def ring(count):
    """Views all around the sphere without a wall, and the sources of each: those that see the same
    of its points."""
    views = []
    for angle in 2 * np.pi * np.arange(count) / count:
        c, s = np.cos(angle), np.sin(angle)
        made = replace(
            view(f"{angle:.2f}", 0, 0)[0], R=np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        )
        points_m = world_points_m(made, surface(made.rays(), made.R, made.t)[0])
        off_m = np.abs(np.linalg.norm(points_m, axis=-1) - RADIUS_M)
        gray = np.where(off_m < 1e-9, texture(points_m), 0.5)
        views.append(replace(made, gray=gray.astype(np.float32)))
    points_m = np.random.default_rng(0).normal(size=(300, 3))
    points_m *= RADIUS_M / np.linalg.norm(points_m, axis=1)[:, None]
    facing = [points_m @ v.centre_m > RADIUS_M * (RADIUS_M + 0.2 * DISTANCE_M) for v in views]
    return views, choose_sources(views, np.transpose(facing), points_m)


def scene(sizes):
    """Views of these sizes [height, width], the true depth of each, and the sources of each."""
    angles = zip(ANGLES, sizes, strict=True)
    taken = [view(f"v{i}", *pair, *size) for i, (pair, size) in enumerate(angles)]
    views, depths_m = zip(*taken, strict=True)
    points_m = np.random.default_rng(0).normal(scale=0.04, size=(50, 3))
    return views, depths_m, choose_sources(views, np.ones((50, 5), dtype=bool), points_m)


def check(maps, depths_m, *, known, rim, angle_deg, points):
    """At least the share `known` of a map is given and right to a twentieth of a pixel of
    disparity, its normals to `angle_deg`; windows at the sphere's rim see two surfaces: 5 % are off
    by up to `rim`. Fused points on the sphere's cap, at least so many, are right."""
    for m, depth_m in zip(maps, depths_m, strict=True):
        given = np.isfinite(m.depth_m)
        error = np.abs(m.depth_m - depth_m)[given] / DISPARITY_M
        _, normals = surface(m.view.rays(), m.view.R, m.view.t)
        cosine = (m.normals * normals).sum(axis=-1)[given]
        assert m.depth_m.shape == m.view.gray.shape and given.mean() > known
        assert np.median(error) < 0.05 and np.quantile(error, 0.95) < rim
        assert np.median(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) < angle_deg
    cloud = fuse(maps)
    cloud = cloud.at((np.abs(cloud.points_m - (0, 0, -0.06)) < (0.05, 0.05, 0.04)).all(axis=1))
    error = np.abs(np.linalg.norm(cloud.points_m, axis=1) - RADIUS_M) / DISPARITY_M
    assert len(cloud.points_m) > points and np.median(error) < 0.05
    assert np.quantile(error, 0.99) < 0.3
