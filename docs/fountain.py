"""The figures of docs/measurements/fountain.md: python -m docs.fountain WORKDIR SURVEYED_CAMERAS MESH.ply OUT.png

WORKDIR and MESH.ply come from `handbench groundtruth … --workdir WORKDIR`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from groundtruth.cameras.cameras import load_pycolmap
from groundtruth.mesh.mesh_files import load_open3d, raycasting_scene, read_mesh
from tests.bench.studies.measure_survey import centre_errors_m, surveyed_centres_m


def render(mesh_file: Path, model_folder: Path, out: Path, width: int = 768) -> None:
    """Shaded mesh as the middle camera sees it."""
    model = load_pycolmap().Reconstruction(str(model_folder))
    images = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
    image = images[len(images) // 2]
    camera, pose = image.camera, image.cam_from_world().matrix()
    step = camera.width / width
    u, v = np.meshgrid(np.arange(0, camera.width, step) + 0.5, np.arange(0, camera.height, step) + 0.5)
    xy = np.asarray(camera.cam_from_img(np.stack([u.ravel(), v.ravel()], axis=1)))
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ pose[:, :3]
    origin = np.broadcast_to(-pose[:, :3].T @ pose[:, 3], rays.shape)
    o3d = load_open3d()
    beams = o3d.core.Tensor(np.hstack([origin, rays]).astype(np.float32))
    cast = raycasting_scene(read_mesh(mesh_file)).cast_rays(beams)
    normals, hit = cast["primitive_normals"].numpy(), np.isfinite(cast["t_hit"].numpy())
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    lit = np.abs((normals * directions).sum(axis=1))
    shade = np.where(hit, 40 + 200 * lit, 255).reshape(u.shape).astype(np.uint8)
    Image.fromarray(shade).save(out, optimize=True)


def main(workdir: Path, surveyed: Path, mesh_file: Path, out: Path) -> None:
    """Print the figures and draw the mesh."""
    model = load_pycolmap().Reconstruction(str(workdir / "sparse"))
    errors_m = centre_errors_m(model, surveyed_centres_m(surveyed))
    print(
        f"registered {len(errors_m)}; camera centres: mean {1e3 * errors_m.mean():.2f} mm, "
        f"max {1e3 * errors_m.max():.2f} mm"
    )
    render(mesh_file, workdir / "sparse", out)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
