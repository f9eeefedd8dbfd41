"""Amplification where rays meet: of a plane under rays along z, and of two cameras' rays."""

from __future__ import annotations

import numpy as np

from groundtruth.cameras.cameras import load_pycolmap
from groundtruth.mesh.depth import depth_on_grid
from groundtruth.mesh.mesh_files import mesh
from groundtruth.sparse.frame import triangulate

FOCAL_PX = 1000.0


def plane_depth(tilt_rad: float, step_m: float = 1e-4) -> float:
    """Change of a tilted plane's depth on a grid when it moves along its normal."""
    sine, cosine = np.sin(tilt_rad), np.cos(tilt_rad)
    along, normal = np.array([cosine, 0.0, sine]), np.array([-sine, 0.0, cosine])
    square = np.array([a * along + b * np.array([0.0, 1.0, 0.0]) for a in (-0.1, 0.1) for b in (-0.1, 0.1)])
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    near_m = 0.5e-2 * np.arange(-1, 2) * cosine  # a few pixels about the middle
    depths_m = [
        depth_on_grid(mesh(square + [0, 0, 0.3] + sign * step_m * normal, faces), near_m, near_m) for sign in (1, -1)
    ]
    return float(np.nanmax(np.abs(depths_m[0] - depths_m[1])) / (2 * step_m))


def triangulated(base_m: float, depth_m: float) -> tuple[float, float]:
    """Change of a point's depth per pixel of disparity between two parallel cameras, and z²/(f·b)."""
    colmap = load_pycolmap()
    camera = colmap.Camera(
        camera_id=1, model="PINHOLE", width=2000, height=2000, params=[FOCAL_PX, FOCAL_PX, 1000, 1000]
    )
    model, point_m = colmap.Reconstruction(), np.array([0.0, 0.0, depth_m])
    model.add_camera_with_trivial_rig(camera)
    for n, x_m in enumerate((-base_m / 2, base_m / 2)):
        pose = colmap.Rigid3d(colmap.Rotation3d(np.eye(3)), np.array([-x_m, 0, 0]))
        model.add_image_with_trivial_frame(colmap.Image(name=f"{n}.png", camera_id=1, image_id=n + 1), pose)
    images = [model.images[n + 1] for n in range(2)]
    pixels = [np.asarray(camera.img_from_cam((image.cam_from_world() * point_m)[None]))[0] for image in images]
    found_m = []
    for change_px in (1e-3, -1e-3):
        apart = (pixels[0] + [change_px / 2, 0], pixels[1] - [change_px / 2, 0])
        found_m.append(triangulate(list(zip(apart, images, strict=True)))[2])
    return abs(found_m[0] - found_m[1]) / 2e-3, depth_m**2 / (FOCAL_PX * base_m)
