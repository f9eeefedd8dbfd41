"""Reconstruction of a metric mesh from photographs, in three stages whose results are cached: from
photographs to cameras in the metric frame, by depth maps to a cloud of points, and to a surface
with uncertainty."""

import tempfile
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handbench.groundtruth.camera_files import write_model
from handbench.groundtruth.cameras import Camera, cuda_devices, registered_images
from handbench.groundtruth.dense import cuda
from handbench.groundtruth.dense.dense import depth_maps, open_views
from handbench.groundtruth.dense.fusion import Cloud, fuse
from handbench.groundtruth.dense.volume import (
    Plane,
    Volume,
    board_plane,
    narrow_volume,
    volume,
    warn_of_cuts,
)
from handbench.groundtruth.mesh import poisson
from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.groundtruth.mesh.poisson import TargetParts, keep_target, remove_board
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.groundtruth.mesh.uncertainty import surface_sigma, window_sigma
from handbench.groundtruth.options import SHRINK, DenseOptions, Options, Region, SparseOptions
from handbench.groundtruth.photos import Photo, find_photos, photo_paths, read_mask
from handbench.groundtruth.pictures import open_picture
from handbench.groundtruth.sparse.inputs import files_given, gather
from handbench.groundtruth.sparse.sparse import Sparse, register
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, one_form, read_json, write_json
from handbench.support.progress import counted, say
from handbench.support.store import Input, Stage, cached, stage

CLOUD, VOLUME = "cloud.npz", "volume.json"
MESH, TARGET, VIEW = "mesh.ply", "target.json", "view.jpg"
SOURCES = ("groundtruth", "calibration/transforms.py")
FILES = {"cameras", "board", "masks"}  # options whose content is in a stage's key
COARSER = 4  # factor on the pixel size of the depth maps that locate the target
COARSEST_PX = 128  # rows of a picture that still show its fingers


@stage("sparse", *SOURCES)
def find_cameras(folder: Path, photos: str, options: dict[str, Any]) -> None:
    """Run the sparse stage: find the cameras of the photographs in the folder `photos`.

    COLMAP model, scale and covariance are written into `folder`. options: fields of SparseOptions.
    Raises HandbenchError, before the work starts, for inputs that cannot be reconstructed.
    """
    chosen = parse(SparseOptions, options, "groundtruth")
    register(gather(Path(photos), chosen), chosen).save(folder)


@stage("dense", *SOURCES)
def fuse_points(folder: Path, photos: str, options: dict[str, Any], sparse: str) -> None:
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
        shrink = coarser(SHRINK[chosen.quality], solved.cameras())
        cloud = _fused(registered, solved, chosen, bounds.box(), shrink)
        bounds = narrow_volume(bounds, cloud, plane, solved)
    say(bounds.describe())
    cloud = poisson.clean(_fused(registered, solved, chosen, bounds.box(), SHRINK[chosen.quality]))
    warn_of_cuts(bounds, cloud, plane)
    cloud.save(folder / CLOUD)
    write_json(folder / VOLUME, vars(bounds))


@stage("mesh", *SOURCES)
def make_mesh(folder: Path, photos: str, options: dict[str, Any], sparse: str, dense: str) -> None:
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


def coarser(shrink: int, cameras: tuple[Camera, ...]) -> int:
    """Return the divisor of the resolution at which the target is located: four times `shrink`, but
    less for small photographs, of which at least 128 rows remain where `shrink` leaves as many."""
    rows = min(min(camera.width, camera.height) for camera in cameras)
    return max(shrink, min(COARSER * shrink, rows // COARSEST_PX))


def _fused(
    photos: tuple[Photo, ...],
    sparse: Sparse,
    options: DenseOptions,
    box_m: np.ndarray | None,
    shrink: int,
) -> Cloud:
    """Compute the depth maps of registered photographs and fuse them to a cloud. shrink: divisor of
    their resolution. box_m [2, 3]: region of interest in the mesh's frame (None: everything)."""
    views, sources = open_views(photos, sparse.model, shrink, box_m, options.masks)
    if options.dense == "cuda":
        return fuse(cuda.depth_maps(views, sources))
    return fuse(depth_maps(views, sources, options.seed))


def measured_surface(
    cloud: Cloud, sparse: Sparse, plane: Plane | None, box_m: np.ndarray | None
) -> tuple[Surface, TargetParts]:
    """Reconstruct the surface of a cloud, keep the target's parts, and compute the standard
    deviation of each vertex.

    plane: of the board, whose points are removed (None: no board). box_m [2, 3]: the surface
    outside is removed. Returns the surface, and a description of the kept and removed parts.
    """
    cloud = cloud if plane is None else remove_board(cloud, plane)
    mesh = poisson.surface(cloud, box_m)
    target = keep_target(mesh, plane, cloud.pixel_m)
    vertices_m, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    sigma_m, observed = surface_sigma(
        cloud, vertices_m, registered_images(sparse.model), sparse.covariance
    )
    sigma_m = np.hypot(sigma_m, window_sigma(vertices_m, faces, observed, cloud.pixel_m))
    scaled = sparse.scale.source != "none"
    return Surface(vertices_m, faces, sigma_m, observed, scaled=scaled), target


def _write_view(photos: Path, camera: Camera, box_m: np.ndarray | None, file: Path) -> None:
    """Write the photograph of one camera to `file` as JPEG, cropped to the part that shows the box
    [2, 3] in the photo frame (None: not cropped). photos: folder of the photographs."""
    path = next(path for path in photo_paths(photos) if one_form(path.name) == camera.name)
    with open_picture(path) as image:
        if box_m is not None:
            corners = camera.project(np.array(list(product(*box_m.T))))
            left, top = np.maximum(corners.min(axis=0), 0)
            right, bottom = np.minimum(corners.max(axis=0), image.size)
            if right - left >= 1 and bottom - top >= 1:
                image = image.crop((left, top, right, bottom))
        image.convert("RGB").save(file, quality=90)


class Reconstruction(NamedTuple):
    """Result of a reconstruction.

    surface: mesh in the photo frame, in metres unless the scale's source is "none". summary:
    statistics as plain values.
    """

    surface: Surface
    summary: dict[str, Any]


def stages(
    root: Path,
    photos: Path,
    options: Options,
    content: list[Any],
    masks: str | None = None,
    capture: str = "",
) -> tuple[Stage, Stage, Stage]:
    """Define the three stages of a reconstruction (sparse, dense and mesh) for the cache at `root`,
    without computing anything.

    content: hashes of the photographs and of the files that belong to them. masks: hash of the
    masks. capture: name of the capture that the photographs belong to. Each stage receives only its
    own options, so its key depends on everything that it uses and on nothing else.
    """

    def of(kind: type[Config], photographs: Any, **made: Stage) -> dict[str, Any]:
        values = options.model_dump(mode="json", include=set(kind.model_fields))
        return {
            "photos": Input(str(photos), photographs),
            "options": Input(values, {key: values[key] for key in values if key not in FILES}),
            **{name: stage.output(root) for name, stage in made.items()},
        }

    sparse = Stage(find_cameras, of(SparseOptions, content), capture, shares=True)
    of_dense = of(DenseOptions, masks, sparse=sparse)
    dense = Stage(fuse_points, of_dense, capture, shares=True)
    of_mesh = of(Region, None, sparse=sparse, dense=dense)
    return sparse, dense, Stage(make_mesh, of_mesh, capture, shares=True)


def reconstruct(
    photos: str | Path, options: Options, workdir: str | Path | None = None
) -> Reconstruction:
    """Reconstruct a metric mesh from the photographs in a folder.

    workdir: folder for the results (None: they are only returned). It receives `sparse/` (COLMAP
    model in the mesh's frame), `dense.ply` (the fused points), `summary.json` (options, statistics,
    seconds) and `stages/`, the cache from which a repeated or interrupted run continues. Raises
    HandbenchError if photographs are missing or broken, cannot be registered, have no scale, or
    show too little surface.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        root = Path(workdir or scratch) / "stages"
        (solved, fused, made), seconds = perform(root, Path(photos), options)
        sparse, cloud = Sparse.load(solved), Cloud.load(fused / CLOUD)
        surface = read_surface(made / MESH, unscaled=True)
        summary = {
            "options": options.model_dump(mode="json"),
            "registered": len(sparse.cameras()),
            "reprojection_error_px": sparse.model.compute_mean_reprojection_error(),
            "scale": asdict(sparse.scale),
            "volume": read_json(fused / VOLUME, "the volume of a dense stage"),
            "target": read_json(made / TARGET, "the target of a mesh stage"),
            "pixel_m": cloud.pixel_m,
            "points": len(cloud.points_m),
            "vertices": len(surface.vertices_m),
            "triangles": len(surface.faces),
            "observed": float(surface.observed.mean()),
            "sigma_m": float(np.median(surface.sigma_m[surface.observed])),
            "seconds": {name: round(time_s, 2) for name, time_s in seconds.items()},
        }
        if workdir is not None:
            workdir = Path(workdir)
            with atomic_folder(workdir / "sparse") as folder:
                write_model(sparse.model, folder)
            columns = by_axis(cloud.points_m) | by_axis(cloud.normals, "n")
            write_ply(workdir / "dense.ply", columns, np.empty((0, 3)), surface.scaled)
            write_json(workdir / "summary.json", summary)
            say(f"{workdir}: wrote sparse/, dense.ply and summary.json")
        return Reconstruction(surface, summary)


def reconstruct_cloud(photos: Path, options: Options) -> Cloud:
    """Reconstruct only the fused cloud of points from the photographs in a folder, without a
    surface. Raises HandbenchError as `reconstruct` does."""
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        (_, fused), _ = perform(Path(scratch), photos, options, count=2)
        return Cloud.load(fused / CLOUD)


def perform(
    root: Path, photos: Path, options: Options, count: int = 3
) -> tuple[list[Path], dict[str, float]]:
    """Run the first `count` stages of a reconstruction, or take their results from the cache at
    `root`. Returns the stages' folders in order, and the seconds that each took, by its name.
    Raises HandbenchError, before the work, for a missing CUDA device and for masks that do not
    fit."""
    devices = 0 if options.dense == "cpu" else cuda_devices()
    if options.dense == "cuda" and not devices:
        raise HandbenchError(
            "dense: CUDA is requested, but pycolmap finds no CUDA device; use a machine with an "
            "NVIDIA card and its driver, run pip install 'handbench[cuda]' (see `handbench "
            "doctor`), or leave the option out"
        )
    options = options.model_copy(update={"dense": "cuda" if devices else "cpu"})
    pictures = find_photos(photos)
    for photo in pictures:
        read_mask(photo, options.masks)
    masks = None if options.masks is None else content_hash(options.masks)
    files = (*(photo.path for photo in pictures), *files_given(photos, options))
    content = [None if file is None else [file.name, content_hash(file)] for file in files]
    folders, seconds = [], {}
    chain = stages(root, photos, options, content, masks)[:count]
    with counted(len(chain)) as work:
        for each in chain:
            with work.part(each.name):
                stamp, finished = cached(root, each)
            if finished:
                say(f"{each.name}: cached")
            folders.append(each.folder(root))
            seconds[each.name] = stamp.seconds
    return folders, seconds
