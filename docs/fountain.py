"""Make the figures of docs/measurements/fountain.md: python -m docs.fountain WORKDIR
SURVEYED_CAMERAS MESH.ply OUT.png

WORKDIR and MESH.ply are written by `handbench groundtruth … --workdir WORKDIR`. SURVEYED_CAMERAS is
the folder with the surveyed positions of the cameras.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pycolmap
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from handbench.bench.studies.measure_survey import (
    centre_errors_m,
    registered_images,
    surveyed_centres_m,
    umeyama,
)
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.mesh.mesh_files import load_open3d, raycasting_scene
from handbench.groundtruth.mesh.surface import Surface, read_surface


def render(
    surface: Surface, model: pycolmap.Reconstruction, metres: float, out: Path, width: int = 1024
) -> None:
    """Draw a mesh as the middle camera sees it, shaded with a scale bar of 1 m, and next to it in
    the colours of its predicted standard deviation.
    model: COLMAP's reconstruction, with the cameras; metres: length of one unit of the model,
    metres, by the surveyed cameras; out: file to write; width: of each picture, pixels."""
    image = registered_images(model)[len(registered_images(model)) // 2]
    camera, pose = image.camera, image.cam_from_world().matrix()
    step = camera.width / width
    u, v = np.meshgrid(
        np.arange(0, camera.width, step) + 0.5, np.arange(0, camera.height, step) + 0.5
    )
    xy = np.asarray(camera.cam_from_img(np.stack([u.ravel(), v.ravel()], axis=1)))
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ pose[:, :3]
    origin = np.broadcast_to(-pose[:, :3].T @ pose[:, 3], rays.shape)
    beams = load_open3d().core.Tensor(np.hstack([origin, rays]).astype(np.float32))
    cast = raycasting_scene(surface.mesh).cast_rays(beams)
    depth_m = metres * cast["t_hit"].numpy().reshape(u.shape)  # along the optical axis
    hit, face = np.isfinite(depth_m), cast["primitive_ids"].numpy().reshape(u.shape)
    lit = np.abs((cast["primitive_normals"].numpy() * rays).sum(axis=1)) / np.linalg.norm(
        rays, axis=1
    )
    sigma_mm = np.full(u.shape, np.nan)
    sigma_mm[hit] = 1e3 * metres * np.nanmean(surface.sigma_m[surface.faces[face[hit]]], axis=1)

    figure = Figure(figsize=(11, 4.1), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(
        np.where(hit, 0.16 + 0.8 * lit.reshape(u.shape), np.nan), cmap="gray", vmin=0, vmax=1
    )
    metre_px = camera.focal_length_x / step / np.median(depth_m[hit])
    left.plot(
        (40, 40 + metre_px), 2 * [len(u) - 30], color="black", linewidth=3, solid_capstyle="butt"
    )
    left.text(
        40 + metre_px / 2,
        len(u) - 40,
        f"1 m at {np.median(depth_m[hit]):.1f} m",
        ha="center",
        fontsize=9,
    )
    scale = LogNorm(*np.nanpercentile(sigma_mm, (1, 99)))
    shown = right.imshow(sigma_mm, cmap="magma_r", norm=scale)
    bar = figure.colorbar(
        shown, ax=right, extend="both", label="predicted σ along the normal in mm"
    )
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    for axis in (left, right):
        axis.set_axis_off()
    figure.savefig(out, dpi=110, pil_kwargs={"optimize": True})
    print(f"median predicted σ {np.nanmedian(sigma_mm):.2f} mm, 1 m is {metre_px:.0f} pixels")


def main(workdir: Path, surveyed: Path, mesh_file: Path, out: Path) -> None:
    """Print the errors of the camera centres against the survey, and draw the mesh with its
    predicted standard deviation."""
    model = load_pycolmap().Reconstruction(str(workdir / "sparse"))
    centres_m = surveyed_centres_m(surveyed)
    errors_m = centre_errors_m(model, centres_m)
    print(
        f"registered {len(errors_m)}; camera centres: mean {1e3 * errors_m.mean():.2f} mm, "
        f"max {1e3 * errors_m.max():.2f} mm"
    )
    ours = np.array([image.projection_center() for image in registered_images(model)])
    theirs_m = np.array([centres_m[image.name] for image in registered_images(model)])
    matrix = umeyama(ours, theirs_m, with_scale=True)
    render(read_surface(mesh_file), model, float(np.cbrt(np.linalg.det(matrix[:3, :3]))), out)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
