"""Reconstruction of a metric mesh from photographs, in three stages whose results are cached."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from handbench.groundtruth import dense_stage, mesh_stage, sparse_stage
from handbench.groundtruth.cameras.camera_files import write_model
from handbench.groundtruth.cameras.cameras import cuda_devices
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense_stage import CLOUD, VOLUME
from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.groundtruth.mesh_stage import MESH, TARGET
from handbench.groundtruth.options import DenseOptions, Options, Region, SparseOptions
from handbench.groundtruth.photos.masks import read_mask
from handbench.groundtruth.photos.photos import find_photos
from handbench.groundtruth.sparse.inputs import files_given
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, read_json, write_json
from handbench.support.progress import counted, say
from handbench.support.store import Input, Stage, cached


class Reconstruction(NamedTuple):
    """Result of a reconstruction.

    surface: mesh in the photo frame, in metres unless the scale's source is "none". seconds: time
    that each stage took, by the stage's name. summary: statistics as plain values.
    """

    surface: Surface
    seconds: dict[str, float]
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
        return {
            "photos": Input(str(photos), photographs),
            "options": Input(options.part(kind), options.part(kind, paths=False)),
            **{name: stage.output(root) for name, stage in made.items()},
        }

    sparse = Stage(sparse_stage.make, of(SparseOptions, content), capture, shares=True)
    of_dense = of(DenseOptions, masks, sparse=sparse)
    dense = Stage(dense_stage.make, of_dense, capture, shares=True)
    of_mesh = of(Region, None, sparse=sparse, dense=dense)
    return sparse, dense, Stage(mesh_stage.make, of_mesh, capture, shares=True)


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
        surface = read_surface(made / MESH)
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
            "seconds": {stage: round(time_s, 2) for stage, time_s in seconds.items()},
        }
        if workdir is not None:
            workdir = Path(workdir)
            with atomic_folder(workdir / "sparse") as folder:
                write_model(sparse.model, folder)
            columns = by_axis(cloud.points_m) | by_axis(cloud.normals, "n")
            write_ply(workdir / "dense.ply", columns, np.empty((0, 3)))
            write_json(workdir / "summary.json", summary)
            say(f"{workdir}: wrote sparse/, dense.ply and summary.json")
        return Reconstruction(surface, seconds, summary)


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
        for stage in chain:
            with work.part(stage.name):
                stamp, finished = cached(root, stage)
            if finished:
                say(f"{stage.name}: cached")
            folders.append(stage.folder(root))
            seconds[stage.name] = stamp.seconds
    return folders, seconds
