"""The second stage of a reconstruction: registered photographs → depth maps → one fused cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from groundtruth.dense import cuda
from groundtruth.dense.dense import depth_maps, open_views
from groundtruth.dense.fusion import Cloud, fuse
from groundtruth.mesh.poisson import clean
from groundtruth.options import DenseOptions
from groundtruth.photos.masks import Masks, find_masks
from groundtruth.photos.photos import Photo, find_photos
from groundtruth.sparse.sparse import Sparse
from radar.support.config import parse

CLOUD = "cloud.npz"


def make(folder: Path, photos: str, options: dict[str, Any], sparse: str) -> None:
    """Fuse the depth maps of the photographs that the sparse stage, in the folder `sparse`, has registered."""
    chosen, solved = parse(DenseOptions, options, "groundtruth"), Sparse.load(Path(sparse))
    names = {camera.name for camera in solved.cameras()}
    registered = tuple(photo for photo in find_photos(Path(photos)) if photo.name in names)
    dense_cloud(registered, solved, chosen).save(folder / CLOUD)


def dense_cloud(photos: tuple[Photo, ...], sparse: Sparse, options: DenseOptions) -> Cloud:
    """The fused cloud of registered photographs."""
    masks = Masks({} if options.masks is None else find_masks(options.masks, photos), options.mask == "colour")
    effort = options.effort
    views, tracks, points_m = open_views(photos, sparse.model, effort.shrink, options.box(), masks)
    if options.dense == "cuda":
        maps = cuda.depth_maps(views, tracks, points_m, options.quality)
    else:
        maps = depth_maps(views, tracks, points_m, effort.iterations, options.seed)
    return clean(fuse(maps, options.box()))
