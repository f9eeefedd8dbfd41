"""Reconstruction of a metric mesh from photographs, in three stages whose results are cached."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.groundtruth import dense_stage, mesh_stage, sparse_stage
from handbench.groundtruth.cameras.camera_files import write_model
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.volume import Volume
from handbench.groundtruth.dense_stage import CLOUD, VOLUME
from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.groundtruth.mesh.target import TargetParts
from handbench.groundtruth.mesh_stage import MESH, TARGET
from handbench.groundtruth.options import DenseOptions, Options, Region, SparseOptions
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.inputs import content, resolve
from handbench.groundtruth.sparse.sparse import Sparse
from handbench.groundtruth.sparse_stage import PHOTOGRAPHS
from handbench.support.config import Config
from handbench.support.files import atomic_folder, content_hash, read_json, write_json
from handbench.support.progress import counted, say
from handbench.support.store import Input, Stage, cached

SUMMARY_VERSION = 1


@dataclass(frozen=True)
class ReconstructedMesh:
    """Result of a reconstruction.

    surface: mesh in the photo frame, in metres unless the scale's source is "none". cloud: the
    fused points. photographs: number of photographs used. scale: where the metric scale comes from.
    volume: the reconstructed box. target: the kept parts of the surface. seconds: time that each
    stage took, by the stage's name.
    """

    surface: Surface
    cloud: Cloud
    cameras: tuple[Camera, ...]
    photographs: int
    reprojection_error_px: float
    scale: Scale
    volume: Volume
    target: TargetParts
    seconds: dict[str, float]

    def summary(self) -> dict[str, object]:
        """Return the statistics of the reconstruction as plain values, for `summary.json`."""
        return {
            "registered": len(self.cameras),
            "photographs": self.photographs,
            "reprojection_error_px": self.reprojection_error_px,
            "scale": asdict(self.scale),
            "volume": asdict(self.volume),
            "target": asdict(self.target),
            "pixel_m": self.cloud.pixel_m,
            "points": len(self.cloud.points_m),
            "vertices": len(self.surface.vertices_m),
            "triangles": len(self.surface.faces),
            "observed": float(self.surface.observed.mean()),
            "sigma_m": float(np.median(self.surface.sigma_m[self.surface.observed])),
            "seconds": {stage: round(seconds, 2) for stage, seconds in self.seconds.items()},
        }


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
) -> ReconstructedMesh:
    """Reconstruct a metric mesh from the photographs in a folder.

    workdir: folder for the results (None: they are only returned). It receives `sparse/` (COLMAP
    model in the mesh's frame), `dense.ply` (the fused points), `summary.json` (completed options,
    statistics, seconds) and `stages/`, the cache from which a repeated or interrupted run
    continues. Raises HandbenchError if photographs are missing or broken, cannot be registered,
    have no scale, or show too little surface.
    """
    with _made(Path(photos), options, workdir) as (options, (solved, fused, made), seconds):
        sparse, cloud, surface = (
            Sparse.load(solved),
            Cloud.load(fused / CLOUD),
            read_surface(made / MESH),
        )
        count = len(read_json(solved / PHOTOGRAPHS, "a sparse stage's photographs"))
        error_px = sparse.model.compute_mean_reprojection_error()
        volume = Volume(**read_json(fused / VOLUME, "the volume of a dense stage"))
        target = TargetParts(**read_json(made / TARGET, "the target of a mesh stage"))
        result = ReconstructedMesh(
            surface, cloud, sparse.cameras(), count, error_px, sparse.scale, volume, target, seconds
        )
        if workdir is not None:
            workdir, facts = (
                Path(workdir),
                {"version": SUMMARY_VERSION, "options": options.model_dump(mode="json")},
            )
            with atomic_folder(workdir / "sparse") as folder:
                write_model(sparse.model, folder)
            columns = by_axis(cloud.points_m) | by_axis(cloud.normals, "n")
            write_ply(workdir / "dense.ply", columns, np.empty((0, 3)))
            write_json(workdir / "summary.json", facts | result.summary())
            say(f"{workdir}: wrote sparse/, dense.ply and summary.json")
        return result


def reconstruct_cloud(
    photos: str | Path, options: Options, workdir: str | Path | None = None
) -> Cloud:
    """Reconstruct only the fused cloud of points from the photographs in a folder, without a
    surface.

    workdir: folder that receives `stages/`, the cache from which a repeated or interrupted run
    continues (None: nothing is kept). Raises HandbenchError if photographs are missing or broken,
    cannot be registered, have no scale, or show too little surface.
    """
    with _made(Path(photos), options, workdir, count=2) as (_, (_, fused), _):
        return Cloud.load(fused / CLOUD)


@contextmanager
def _made(
    photos: Path, options: Options, workdir: str | Path | None, count: int = 3
) -> Iterator[tuple[Options, list[Path], dict[str, float]]]:
    """Run the first `count` stages of a reconstruction, or take their results from the cache.

    Yields the completed options, the stages' folders in order, and the seconds that each stage
    took, by its name. Without a workdir, the folders exist only within the `with` statement.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        root = Path(scratch if workdir is None else workdir) / "stages"
        inputs, options = resolve(photos, options)
        masks = (
            None
            if options.masks is None or not options.masks.exists()
            else content_hash(options.masks)
        )
        seconds = {}
        chain = stages(root, photos, options, content(inputs, options), masks)[:count]
        with counted(len(chain)) as work:
            for stage in chain:
                with work.part(stage.name):
                    stamp, finished = cached(root, stage)
                if finished:
                    say(f"{stage.name}: cached")
                seconds[stage.name] = stamp.seconds
        yield options, [stage.folder(root) for stage in chain], seconds
