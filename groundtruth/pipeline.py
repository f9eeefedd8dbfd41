"""Photographs to a metric mesh: three stages, each kept in a folder named by what it depends on."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from groundtruth.cameras.cameras import Camera, registered
from groundtruth.cameras.model_files import write_model
from groundtruth.dense.fusion import Cloud, fuse
from groundtruth.mesh.mesh_files import write_cloud
from groundtruth.mesh.surface import Surface, read_surface
from groundtruth.options import Options
from groundtruth.sparse.frame import Scale
from groundtruth.sparse.inputs import Inputs, gather
from groundtruth.sparse.sparse import Sparse, register
from radar.support.files import atomic_folder, read_json, write_json
from radar.support.progress import say
from radar.support.store import keep, key_of

SUMMARY_VERSION = 1
SOURCES = (
    "groundtruth",
    "calibration/transforms.py",
    "groundtruth/mesh/mesh_files.py",
    "groundtruth/mesh/ply.py",
    "radar/support/rays.py",
)
REGISTRATION = {"intrinsics", "metric", "distances", "unscaled", "seed"}  # options that the sparse stage depends on
STAMP, CLOUD, MESH = "stage.json", "cloud.npz", "mesh.ply"


@dataclass(frozen=True)
class Result:
    """A surface in the photo frame (metres, unless the scale's source is "none"), the fused cloud it was made of, and
    how well the photographs fit together."""

    surface: Surface
    cloud: Cloud
    cameras: tuple[Camera, ...]
    photographs: int
    reprojection_error_px: float
    scale: Scale
    seconds: dict[str, float]

    def summary(self) -> dict[str, object]:
        """Plain values for `summary.json`."""
        return {
            "registered": len(self.cameras),
            "photographs": self.photographs,
            "reprojection_error_px": self.reprojection_error_px,
            "scale": asdict(self.scale),
            "pixel_m": self.cloud.pixel_m,
            "points": len(self.cloud.points_m),
            "vertices": len(self.surface.vertices_m),
            "triangles": len(self.surface.faces),
            "observed": float(self.surface.observed.mean()),
            "sigma_m": float(np.median(self.surface.sigma_m[self.surface.observed])),
            "seconds": {stage: round(seconds, 2) for stage, seconds in self.seconds.items()},
        }


@dataclass
class Stages:
    """Stages kept under `root`, and the seconds that each took when it was made."""

    root: Path
    seconds: dict[str, float] = field(default_factory=dict)

    def __call__(self, name: str, depends_on: list[Any], make: Callable[[Path], None]) -> Path:
        """The folder that make(folder) fills, or filled for the same things that it depends on."""
        folder = self.root / f"{name}-{key_of(SOURCES, name, *depends_on)[:16]}"

        def timed(temporary: Path) -> None:
            start = time.perf_counter()
            make(temporary)
            write_json(temporary / STAMP, {"seconds": time.perf_counter() - start})

        if keep(folder, timed):
            say(f"{name}: cached")
        self.seconds[name] = read_json(folder / STAMP, "a stage's stamp")["seconds"]
        return folder


def reconstruct(photos: str | Path, options: Options, workdir: str | Path | None = None) -> Result:
    """Photographs in a folder to a mesh.

    workdir receives `sparse/` (COLMAP model in the mesh's frame), `dense.ply` (the fused cloud), `summary.json`
    (resolved options, figures, seconds) and `stages/`, from which a repeated or killed run goes on. Raises
    HandbenchError when photographs are missing or broken, do not register, carry no scale, or show too little surface.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        stages = Stages(Path(scratch if workdir is None else workdir) / "stages")
        inputs, options = gather(Path(photos), options)
        result, sparse = _reconstruct(inputs, options, stages)
        if workdir is not None:
            _write(Path(workdir), result, sparse, options)
        return result


def reconstruct_cloud(photos: str | Path, options: Options, workdir: str | Path | None = None) -> Cloud:
    """As `reconstruct`, but no further than the fused cloud; workdir receives `stages/` alone."""
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        inputs, options = gather(Path(photos), options)
        return _cloud(inputs, options, Stages(Path(scratch if workdir is None else workdir) / "stages"))[0]


def _reconstruct(inputs: Inputs, options: Options, stages: Stages) -> tuple[Result, Sparse]:
    def make_surface(folder: Path) -> None:
        _surface(cloud, sparse, options).save(folder / MESH)

    cloud, sparse, fused = _cloud(inputs, options, stages)
    surface = read_surface(stages("mesh", [fused, options.components], make_surface) / MESH)
    error_px = sparse.model.compute_mean_reprojection_error()
    result = Result(surface, cloud, sparse.cameras(), len(inputs.photos), error_px, sparse.scale, stages.seconds)
    return result, sparse


def _cloud(inputs: Inputs, options: Options, stages: Stages) -> tuple[Cloud, Sparse, str]:
    """The fused cloud, the cameras, and the name of the stage that made the cloud."""

    def make_sparse(folder: Path) -> None:
        register(inputs, options).save(folder)

    def make_dense(folder: Path) -> None:
        _dense_cloud(inputs, sparse, options).save(folder / CLOUD)

    chosen = options.model_dump(mode="json", include=REGISTRATION)
    solved = stages("sparse", [inputs.content(), chosen], make_sparse)
    sparse = Sparse.load(solved)
    chosen_pixels = [options.quality, options.box_m, inputs.masks.content(), options.dense]
    fused = stages("dense", [solved.name, *chosen_pixels, options.seed], make_dense)
    return Cloud.load(fused / CLOUD), sparse, fused.name


def _dense_cloud(inputs: Inputs, sparse: Sparse, options: Options) -> Cloud:
    from groundtruth.dense import cuda
    from groundtruth.dense.dense import depth_maps, open_views
    from groundtruth.mesh.poisson import clean

    effort = options.effort
    views, tracks, points_m = open_views(inputs.photos, sparse.model, effort.shrink, options.box(), inputs.masks)
    if options.dense == "cuda":
        maps = cuda.depth_maps(views, tracks, points_m, options.quality)
    else:
        maps = depth_maps(views, tracks, points_m, effort.iterations, options.seed)
    return clean(fuse(maps, options.box()))


def _surface(cloud: Cloud, sparse: Sparse, options: Options) -> Surface:
    from groundtruth.mesh.poisson import surface
    from groundtruth.mesh.uncertainty import surface_sigma

    mesh = surface(cloud, options.components, options.box())
    vertices_m = np.asarray(mesh.vertices)
    sigma_m, observed = surface_sigma(cloud, vertices_m, registered(sparse.model), sparse.known)
    return Surface(vertices_m, np.asarray(mesh.triangles), sigma_m, observed)


def _write(workdir: Path, result: Result, sparse: Sparse, options: Options) -> None:
    with atomic_folder(workdir / "sparse") as folder:
        write_model(sparse.model, folder)
    write_cloud(workdir / "dense.ply", result.cloud.points_m, result.cloud.normals)
    write_json(
        workdir / "summary.json",
        {"version": SUMMARY_VERSION, "options": options.model_dump(mode="json"), **result.summary()},
    )
    say(f"{workdir}: sparse/, dense.ply and summary.json written")
