"""One hand with one bitmap before the same cameras, photographed by Mitsuba and by handbench, and
reconstructed.

python -m tests.references.renderers.measure_renderers [--poses C,MESH.ply] [-o DIR]

Mitsuba is no dependency of handbench: pip install mitsuba. The hand stands without its block before
pinhole cameras, and the volume is not measured. DIR/work keeps the photographs, DIR gets the files
of a study.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from handbench.bench.datasets.simulated import write_photographs
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.photographs import Studio
from handbench.bench.studies.photogrammetry.measure_photogrammetry import reconstructed, tables
from handbench.bench.studies.photogrammetry.photogrammetry_cases import PhotogrammetryCase
from handbench.bench.studies.study import Record, Study, measured, parser
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.options import Options
from handbench.support.files import atomic_folder, content_hash
from tests.references.renderers.atlas import Atlas
from tests.references.renderers.path_tracer import PathTracer


@dataclass(frozen=True)
class Rendered(PhotogrammetryCase):
    """A hand that carries a bitmap; renderer: of its photographs, mitsuba or handbench."""

    renderer: str = "handbench"


def renderers(poses: tuple[str, ...]) -> Iterator[Rendered]:
    """Both renderers' photographs of each pose."""
    for seed, pose in enumerate(poses, start=401):
        yield Rendered("8 views by Mitsuba", pose, seed, renderer="mitsuba")
        yield Rendered("the same by handbench", pose, seed)


def measure(case: Rendered, work: Path) -> Record:
    """Photographs and stages are kept under `work`."""
    file = case.scene_file()
    scene = floating(build(file, Path(case.pose).parent))
    mesh = content_hash(Path(case.pose)) if case.is_file else ""
    values = {**file.model_dump(mode="json", exclude={"name"}), "mesh": mesh}
    folder = work / f"{Path(case.pose).stem}-{case.renderer}-{content_hash(values)[:12]}"
    if not (folder / "capture").is_dir():
        with atomic_folder(folder / "capture") as temporary:
            photograph(scene, case.renderer, temporary / "photos")
    photos, options = folder / "capture" / "photos", Options(quality=case.quality)
    return reconstructed(case, scene, photos, options, folder / "reconstruction")


def photograph(scene: Scene, renderer: str, folder: Path) -> None:
    """Write the photographs of a scene whose target carries a bitmap, as one of the renderers takes
    them."""
    folder.mkdir(parents=True)
    vertices_m = scene.radar_from_photo.inverse().points(np.asarray(scene.target_mesh.vertices))
    atlas = Atlas.of(vertices_m, np.asarray(scene.target_mesh.triangles), scene.file.seed)
    take: Callable[[Camera, int], np.ndarray]
    if renderer == "mitsuba":
        take = PathTracer(scene, atlas).photograph
    else:
        studio = Studio(scene)
        studio.bodies[0] = replace(studio.bodies[0], albedo=atlas.reflectance)
        take = studio.photograph
    write_photographs(scene, folder, take)


def floating(scene: Scene) -> Scene:
    """The scene without its block, before pinhole cameras: nothing but the target stands off the
    board."""
    low, high = scene.target_mesh.get_min_bound(), scene.target_mesh.get_max_bound()
    corners_m = scene.radar_from_photo.inverse().points(
        np.array(list(product(*zip(low, high, strict=True))))
    )
    box_m = np.stack([corners_m.min(axis=0), corners_m.max(axis=0)])
    return replace(scene, cameras=tuple(map(pinhole, scene.cameras)), block_m=None, box_m=box_m)


def pinhole(camera: Camera) -> Camera:
    """The camera with square pixels and without distortion."""
    focal_px, _, *centre_px = camera.params[:4]
    return camera.model_copy(
        update={"model": "PINHOLE", "params": (focal_px, focal_px, *centre_px)}
    )


def study(work: Path, poses: str) -> Study:
    """Every hand, by both renderers."""
    return Study(
        "photogrammetry_renderers",
        list(renderers(tuple(poses.split(",")))),
        lambda case: measure(case, work),
        tables,
        label=lambda case: f"{case.name}, {case.pose}",
    )


def main() -> None:
    """Measure, write the files of a study, print the table."""
    options = parser("renderers", (__doc__ or "").partition("\n")[0])
    options.prog = "python -m tests.references.renderers.measure_renderers"
    poses = "letters or mesh files of hands, separated by commas (default C)"
    options.add_argument("--poses", default="C", help=poses)
    measured(options, study, "renderers")


if __name__ == "__main__":
    main()
