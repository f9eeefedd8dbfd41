"""The second stage of a reconstruction: from registered photographs to one fused cloud of points,
by depth maps."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.dense.dense import depth_maps, open_views
from handbench.groundtruth.dense.fusion import Cloud, fuse
from handbench.groundtruth.dense.kernels import announce
from handbench.groundtruth.dense.volume import board_plane, narrow_volume, volume, warn_of_cuts
from handbench.groundtruth.mesh.poisson import clean
from handbench.groundtruth.options import DenseOptions, Effort
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.config import parse
from handbench.support.files import write_json
from handbench.support.progress import say
from handbench.support.store import stage

CLOUD, VOLUME = "cloud.npz", "volume.json"
COARSER = 4  # factor on the pixel size of the depth maps that locate the target
COARSEST_PX = 64  # rows of a picture that still show it


@stage("dense", "groundtruth", "calibration/transforms.py")
def make(folder: Path, photos: str, options: dict[str, Any], sparse: str) -> None:
    """Run the dense stage: compute the depth maps of the photographs that the sparse stage
    registered, and fuse them to a cloud of points.

    The cloud (cloud.npz) and the reconstructed box (volume.json) are written into `folder`. photos:
    folder of the photographs. options: fields of DenseOptions. sparse: folder that the sparse stage
    wrote.
    """
    chosen, solved = parse(DenseOptions, options, "groundtruth"), Sparse.load(Path(sparse))
    names = {camera.name for camera in solved.cameras()}
    registered = tuple(photo for photo in find_photos(Path(photos)) if photo.name in names)
    plane = board_plane(Path(photos), chosen.board, solved)
    bounds = volume(chosen.box_m, plane, solved)
    if plane is not None and bounds.source != "given" and chosen.dense != "cuda":
        coarse = Effort(coarser(chosen.effort.shrink, solved.cameras()), 1)
        bounds = narrow_volume(
            bounds, _fused(registered, solved, chosen, bounds.box(), coarse), plane
        )
    say(bounds.describe())
    cloud = clean(_fused(registered, solved, chosen, bounds.box(), chosen.effort))
    warn_of_cuts(bounds, cloud, plane)
    cloud.save(folder / CLOUD)
    write_json(folder / VOLUME, vars(bounds))


def coarser(shrink: int, cameras: Iterable[Camera]) -> int:
    """Return the divisor of the resolution at which the target is located: four times `shrink`, but
    less for small photographs, of which at least 64 rows remain where `shrink` leaves as many."""
    rows = min(min(camera.width, camera.height) for camera in cameras)
    return max(shrink, min(COARSER * shrink, rows // COARSEST_PX))


def _fused(
    photos: tuple[Photo, ...],
    sparse: Sparse,
    options: DenseOptions,
    box_m: np.ndarray | None,
    effort: Effort,
) -> Cloud:
    """Compute the depth maps of registered photographs and fuse them to a cloud. effort: resolution
    and number of iterations. box_m [2, 3]: region of interest in the mesh's frame (None:
    everything)."""
    views, sources = open_views(photos, sparse.model, effort.shrink, box_m, options.masks)
    announce()
    if options.dense == "cuda":
        return fuse(cuda.depth_maps(views, sources, options.quality))
    return fuse(depth_maps(views, sources, effort.iterations, options.seed))
