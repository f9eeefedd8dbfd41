"""The last stage of a reconstruction: from the fused cloud of points to a surface with
uncertainty."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera, registered_images
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.volume import Plane, Volume, board_plane
from handbench.groundtruth.dense_stage import CLOUD, VOLUME
from handbench.groundtruth.mesh.poisson import surface
from handbench.groundtruth.mesh.surface import Surface
from handbench.groundtruth.mesh.target import TargetParts, keep_target, remove_board
from handbench.groundtruth.mesh.uncertainty import surface_sigma, window_sigma
from handbench.groundtruth.options import Region
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.config import parse
from handbench.support.files import read_json, write_json
from handbench.support.pictures import open_picture
from handbench.support.store import stage

MESH, TARGET, VIEW = "mesh.ply", "target.json", "view.jpg"


@stage("mesh", "groundtruth", "calibration/transforms.py")
def make(folder: Path, photos: str, options: dict[str, Any], sparse: str, dense: str) -> None:
    """Run the mesh stage: reconstruct the surface of the dense stage's cloud.

    Three files are written into `folder`: the surface (mesh.ply), the description of its kept and
    removed parts (target.json), and a photograph cropped to the reconstructed box (view.jpg).
    photos: folder of the photographs. options: fields of Region. sparse, dense: folders that
    the sparse and the dense stage wrote.
    """
    chosen, solved = parse(Region, options, "groundtruth"), Sparse.load(Path(sparse))
    box_m = Volume(**read_json(Path(dense) / VOLUME, "the volume of a dense stage")).box()
    plane = board_plane(Path(photos), chosen.board, solved)
    cloud = Cloud.load(Path(dense) / CLOUD)
    made, target = measured_surface(cloud, solved, plane, box_m)
    made.save(folder / MESH)
    write_json(folder / TARGET, vars(target))
    _write_view(Path(photos), solved.cameras()[0], box_m, folder / VIEW)


def measured_surface(
    cloud: Cloud, sparse: Sparse, plane: Plane | None, box_m: np.ndarray | None
) -> tuple[Surface, TargetParts]:
    """Reconstruct the surface of a cloud, keep the target's parts, and compute the standard
    deviation of each vertex.

    plane: of the board, whose points are removed (None: no board). box_m [2, 3]: the surface
    outside is removed. Returns the surface, and a description of the kept and removed parts.
    """
    cloud = cloud if plane is None else remove_board(cloud, plane)
    mesh = surface(cloud, box_m)
    target = keep_target(mesh, plane, cloud.pixel_m)
    vertices_m, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    sigma_m, observed = surface_sigma(
        cloud, vertices_m, registered_images(sparse.model), sparse.known
    )
    sigma_m = np.hypot(sigma_m, window_sigma(vertices_m, faces, observed, cloud.pixel_m))
    return Surface(vertices_m, faces, sigma_m, observed), target


def _write_view(photos: Path, camera: Camera, box_m: np.ndarray | None, file: Path) -> None:
    """Write the photograph of one camera to `file` as JPEG, cropped to the part that shows the box
    [2, 3] in the photo frame (None: not cropped). photos: folder of the photographs."""
    path = next(photo.path for photo in find_photos(photos) if photo.name == camera.name)
    with open_picture(path) as image:
        if box_m is not None:
            corners = camera.project(np.array(list(product(*box_m.T))))
            left, top = np.maximum(corners.min(axis=0), 0)
            right, bottom = np.minimum(corners.max(axis=0), image.size)
            if right - left >= 1 and bottom - top >= 1:
                image = image.crop((left, top, right, bottom))
        image.convert("RGB").save(file, quality=90)
