"""The last stage of a reconstruction: the fused cloud → a surface that says how well it is known."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from groundtruth.cameras.cameras import Camera, registered
from groundtruth.dense.fusion import Cloud
from groundtruth.dense_stage import CLOUD
from groundtruth.mesh.poisson import surface
from groundtruth.mesh.surface import Surface
from groundtruth.mesh.uncertainty import surface_sigma
from groundtruth.options import MeshOptions
from groundtruth.photos.photos import find_photos
from groundtruth.sparse.sparse import Sparse
from radar.support.config import parse

MESH, VIEW = "mesh.ply", "view.jpg"


def make(folder: Path, photos: str, options: dict[str, Any], sparse: str, dense: str) -> None:
    """The surface of the dense stage's cloud in the photo frame → MESH, and the first photograph, cut to the box →
    VIEW; sparse, dense: these stages' folders."""
    chosen, solved = parse(MeshOptions, options, "groundtruth"), Sparse.load(Path(sparse))
    measured_surface(Cloud.load(Path(dense) / CLOUD), solved, chosen).save(folder / MESH)
    _write_view(Path(photos), solved.cameras()[0], chosen.box(), folder / VIEW)


def measured_surface(cloud: Cloud, sparse: Sparse, options: MeshOptions) -> Surface:
    """The cloud's surface with the standard deviation of each vertex."""
    mesh = surface(cloud, options.components, options.box())
    vertices_m = np.asarray(mesh.vertices)
    sigma_m, observed = surface_sigma(cloud, vertices_m, registered(sparse.model), sparse.known)
    return Surface(vertices_m, np.asarray(mesh.triangles), sigma_m, observed)


def _write_view(photos: Path, camera: Camera, box_m: np.ndarray | None, file: Path) -> None:
    """The camera's photograph, cut to the box [2, 3] in the photo frame."""
    from PIL import Image

    path = next(photo.path for photo in find_photos(photos) if photo.name == camera.name)
    with Image.open(path) as image:
        if box_m is not None:
            corners = camera.project(np.array(list(product(*box_m.T))))
            left, top = np.maximum(corners.min(axis=0), 0)
            right, bottom = np.minimum(corners.max(axis=0), image.size)
            if right - left >= 1 and bottom - top >= 1:
                image = image.crop((left, top, right, bottom))
        image.convert("RGB").save(file, quality=90)
