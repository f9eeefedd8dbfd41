"""A textured sphere before a wall, whose depth is known in closed form."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.groundtruth.dense.dense import choose_sources
from handbench.groundtruth.dense.fusion import fuse
from handbench.groundtruth.dense.views import View

RADIUS_M = 0.07  # of the sphere about the origin
WALL_M = 0.05  # behind it
DISTANCE_M = 0.5  # of the cameras
FOCAL_PX, SIZE = 260.0, 112
PIXEL_M = (DISTANCE_M - RADIUS_M) / FOCAL_PX  # on the surface: 1.7 mm
# depth per pixel of disparity, at a baseline of 14°: 5.9 mm
DISPARITY_M = PIXEL_M * (DISTANCE_M - RADIUS_M) / 0.12
ANGLES_DEG = [(0, 0), (0, 14), (0, -14), (13, 3), (-13, -3)]  # about x and y


def texture(points_m):
    """A solid texture of waves, none shorter than 4 pixels."""
    rng = np.random.default_rng(5)
    waves = rng.normal(size=(60, 3))
    waves *= 2 * np.pi / (PIXEL_M * rng.uniform(4, 20, 60) * np.linalg.norm(waves, axis=1))[:, None]
    return 0.5 + 0.06 * np.sin(points_m @ waves.T + rng.uniform(0, 2 * np.pi, 60)).sum(axis=-1)


def surface(view):
    """Depth [h, w], world points and world normals [h, w, 3] of what a camera sees along its rays
    with z = 1, and whether [h, w] that is the sphere."""
    rays, centre = view.rays() @ view.R, view.centre_m
    a, b, c = (rays**2).sum(axis=-1), rays @ centre, centre @ centre - RADIUS_M**2
    root = b**2 - a * c
    hit = root > 0
    on_sphere_m, on_wall_m = (-b - np.sqrt(root.clip(0))) / a, (WALL_M - centre[2]) / rays[..., 2]
    depth_m = np.where(hit, on_sphere_m, on_wall_m)
    points_m = centre + rays * depth_m[..., None]
    return depth_m, points_m, np.where(hit[..., None], points_m / RADIUS_M, (0.0, 0.0, -1.0)), hit


def view(name, R, size=(SIZE, SIZE), wall=True):
    """What a camera with the rotation R sees of the sphere and of the wall, if there is one."""
    height, width = size
    t = np.array([0, 0, DISTANCE_M])
    K = np.array([[FOCAL_PX, 0, width / 2 - 0.5], [0, FOCAL_PX, height / 2 - 0.5], [0, 0, 1]])
    near_m, far_m = (np.full(size, z, dtype=np.float32) for z in (0.40, 0.62))
    bare = View(name, np.zeros(size, np.float32), K, R, t, near_m, far_m)
    _, points_m, _, hit = surface(bare)
    gray = np.where(hit | wall, texture(points_m), 0.5)
    return replace(bare, gray=gray.astype(np.float32))


def ring(count):
    """Views all around the sphere without a wall, and the sources of each: those that see the same
    of its points."""
    angles = 2 * np.pi * np.arange(count) / count
    turns = Rotation.from_euler("y", angles[:, None]).as_matrix()
    views = [view(f"{i}", R, wall=False) for i, R in enumerate(turns)]
    points_m = np.random.default_rng(0).normal(size=(300, 3))
    points_m *= RADIUS_M / np.linalg.norm(points_m, axis=1)[:, None]
    facing = [points_m @ v.centre_m > RADIUS_M * (RADIUS_M + 0.2 * DISTANCE_M) for v in views]
    return views, choose_sources(views, np.transpose(facing), points_m)


def scene(sizes=((SIZE, SIZE),) * 5):
    """Views of these sizes [height, width], and the sources of each."""
    turns = Rotation.from_euler("xy", ANGLES_DEG, degrees=True).as_matrix()
    views = [view(f"v{i}", *pair) for i, pair in enumerate(zip(turns, sizes, strict=True))]
    points_m = np.random.default_rng(0).normal(scale=0.04, size=(50, 3))
    return views, choose_sources(views, np.ones((50, 5), dtype=bool), points_m)


def check(maps, *, known, rim, angle_deg, points):
    """At least the share `known` of a map is given and right to a twentieth of a pixel of
    disparity, its normals to `angle_deg`; windows at the sphere's rim see two surfaces: 5 % are off
    by up to `rim`. Fused points on the sphere's cap, at least so many, are right."""
    for m in maps:
        depth_m, _, normals, _ = surface(m.view)
        given = np.isfinite(m.depth_m)
        error = np.abs(m.depth_m - depth_m)[given] / DISPARITY_M
        cosine = (m.normals * normals).sum(axis=-1)[given]
        assert m.depth_m.shape == m.view.gray.shape and given.mean() > known
        assert np.median(error) < 0.05 and np.quantile(error, 0.95) < rim
        assert np.median(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) < angle_deg
    cloud = fuse(maps)
    cloud = cloud.at((np.abs(cloud.points_m - (0, 0, -0.06)) < (0.05, 0.05, 0.04)).all(axis=1))
    error = np.abs(np.linalg.norm(cloud.points_m, axis=1) - RADIUS_M) / DISPARITY_M
    assert len(cloud.points_m) > points and np.median(error) < 0.05
    assert np.quantile(error, 0.99) < 0.3
