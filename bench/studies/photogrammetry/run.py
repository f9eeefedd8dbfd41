"""One case: photographs rendered, reconstructed as a user would, and scored."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from bench.scenes.build import build
from bench.scenes.capture_folder import write_photos
from bench.studies.photogrammetry.cases import Case
from bench.studies.photogrammetry.score import Score, score
from groundtruth.options import Options
from groundtruth.pipeline import reconstruct
from radar.support.cost import measured
from radar.support.files import content_hash
from radar.support.store import keep


@dataclass(frozen=True)
class Row:
    """A case and what came of it; seconds: by stage, when it was made; peak_memory_mb: of the whole process (small
    where stages had been made before)."""

    case: Case
    score: Score
    seconds: dict[str, float]
    peak_memory_mb: float

    @property
    def total_s(self) -> float:
        """All stages together."""
        return sum(self.seconds.values())


def run(case: Case, work: Path) -> Row:
    """Photographs and stages are kept under `work`, so that cases which share them do so."""
    file = case.scene_file()
    scene = build(file)
    folder = work / f"{file.target.pose}-{content_hash(file.model_dump(mode='json', exclude={'name'}))[:12]}"
    keep(folder / "capture", lambda temporary: write_photos(scene, temporary))
    photos = folder / "capture" / "photos"
    if not case.known:
        photos = folder / "unknown"
        keep(photos, lambda temporary: _without_intrinsics(folder / "capture" / "photos", temporary))
    options = Options(quality=case.quality, box_m=tuple(scene.box_m.ravel()), components="all")
    with measured() as cost:
        result = reconstruct(photos, options, folder / "reconstruction")
    return Row(case, score(result, scene), result.seconds, cost.peak_memory_mb)


def _without_intrinsics(photos: Path, folder: Path) -> None:
    shutil.copytree(photos, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*cameras.json"))
