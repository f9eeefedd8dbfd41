"""Photographs of hands rendered, reconstructed as a user would, and scored against the truth."""

from __future__ import annotations

import shutil
from pathlib import Path

from bench.datasets.simulated import write_photos
from bench.scenes.build import build
from bench.studies.columns import Record, rows
from bench.studies.photogrammetry.cases import Case, bars, sweep
from bench.studies.photogrammetry.figure import draw
from bench.studies.photogrammetry.score import score
from bench.studies.study import Study
from groundtruth.options import Options
from groundtruth.pipeline import reconstruct
from radar.support.cost import measured
from radar.support.files import content_hash
from radar.support.store import keep


def study(work: Path, what: str, poses: str) -> Study:
    """`bars`: what a ground truth is held to, on all poses; `sweep`: its price in time, on the first one."""
    letters = tuple(poses.split(","))
    return Study(
        f"photogrammetry_{what}",
        "Photogrammetry of rendered hands",
        list(bars(letters) if what == "bars" else sweep(letters[0])),
        lambda case: measure(case, work),
        rows("photogrammetry"),
        draw if what == "sweep" else lambda frames: None,
        label=lambda case: f"{case.name}, {case.pose}",
    )


def measure(case: Case, work: Path) -> Record:
    """Photographs and stages are kept under `work`, so that cases which share them do so."""
    file = case.scene_file()
    scene = build(file)
    folder = work / f"{file.target.pose}-{content_hash(file.model_dump(mode='json', exclude={'name'}))[:12]}"
    keep(folder / "capture", lambda temporary: write_photos(scene, temporary))
    photos = folder / "capture" / "photos"
    if not case.known:
        photos = folder / "unknown"
        keep(photos, lambda temporary: _without_intrinsics(folder / "capture" / "photos", temporary))
    lens = None if case.known else False  # each rendered camera has a lens of its own, and none has EXIF data
    options = Options(quality=case.quality, box_m=tuple(scene.box_m.ravel()), shared_intrinsics=lens)
    with measured() as cost:
        result = reconstruct(photos, options, folder / "reconstruction")
    return record(case, score(result, scene), result.seconds, cost.peak_memory_mb)


def record(case: Case, scored: Record, seconds: dict[str, float], peak_memory_mb: float) -> Record:
    """A case with its score, and the seconds by stage."""
    about = {
        "case": case.name,
        "pose": case.pose,
        "cameras": case.cameras,
        "width": case.width,
        "quality": case.quality,
    }
    times = {f"{stage}_s": value for stage, value in seconds.items()}
    return {**about, **scored, **times, "all_s": sum(seconds.values()), "peak_memory_mb": peak_memory_mb}


def _without_intrinsics(photos: Path, folder: Path) -> None:
    shutil.copytree(photos, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*cameras.json"))
