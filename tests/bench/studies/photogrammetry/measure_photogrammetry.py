"""Photographs of hands rendered, reconstructed as a user would, and scored against the truth.

python -m tests.bench.studies.photogrammetry.measure_photogrammetry bars|sweep [--poses C,Y] [-o
DIR]

`bars`: what a ground truth is held to. `sweep`: its price in time, on the first pose.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.scenes.build import Scene, build
from handbench.groundtruth.options import Options
from handbench.groundtruth.pipeline import reconstruct
from handbench.support.cost import measured as costs
from handbench.support.files import atomic_folder, content_hash
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.photogrammetry.photogrammetry_cases import Case, bars, sweep
from tests.bench.studies.photogrammetry.photogrammetry_score import score
from tests.bench.studies.script import measured
from tests.bench.studies.study import BLUE, GREEN, ORANGE, Study

CASES = {"bars": bars, "sweep": lambda poses: sweep(poses[0])}


def study(work: Path, what: str, poses: str) -> Study:
    """`bars`: what a ground truth is held to, on all poses; `sweep`: its price in time, on the
    first one."""
    return Study(
        f"photogrammetry_{what}",
        "Photogrammetry of rendered hands",
        list(CASES[what](tuple(poses.split(",")))),
        lambda case: measure(case, work),
        tables,
        draw if what == "sweep" else lambda frames: None,
        label=lambda case: f"{case.name}, {case.pose}",
    )


def tables(records: list[Record]) -> list[Table]:
    """The one table, of all records."""
    return [Table("rows", declared_tables(__file__)["rows"].columns, records)]


def measure(case: Case, work: Path) -> Record:
    """Photographs and stages are kept under `work`, so that cases which share them do so."""
    file = case.scene_file()
    scene = build(file, Path(case.pose).parent)
    mesh = {"mesh": content_hash(Path(case.pose))} if case.is_file else {}
    values = {**file.model_dump(mode="json", exclude={"name"}), **mesh}
    folder = work / f"{Path(case.pose).stem}-{content_hash(values)[:12]}"
    if not (folder / "capture").is_dir():
        with atomic_folder(folder / "capture") as temporary:
            write_photos(scene, temporary)
    photos = folder / "capture" / "photos"
    if not case.known:
        photos = folder / "unknown"
        intrinsics = shutil.ignore_patterns("*cameras.json")
        if not photos.is_dir():
            with atomic_folder(photos) as temporary:
                shutil.copytree(
                    folder / "capture" / "photos", temporary, dirs_exist_ok=True, ignore=intrinsics
                )
    lens = (
        None if case.known else False
    )  # each rendered camera has a lens of its own, and none has EXIF data
    options = Options(
        quality=case.quality, box_m=tuple(scene.box_m.ravel()), shared_intrinsics=lens
    )
    return reconstructed(case, scene, photos, options, folder / "reconstruction")


def reconstructed(
    case: Case, scene: Scene, photos: Path, options: Options, workdir: Path
) -> Record:
    """The case's record: its photographs reconstructed, and scored against the scene that they
    show."""
    with costs() as cost:
        result = reconstruct(photos, options, workdir)
    scored = {**score(result, scene), "cpu_s": cost.cpu_seconds}
    return record(case, scored, result.seconds, cost.peak_memory_mb)


def record(case: Case, scored: Record, seconds: dict[str, float], peak_memory_mb: float) -> Record:
    """A case with its score, and the seconds by stage."""
    about = {"case": case.name} | {
        name: getattr(case, name) for name in ("pose", "cameras", "width", "quality")
    }
    times = {f"{stage}_s": value for stage, value in seconds.items()}
    return {
        **about,
        **scored,
        **times,
        "all_s": sum(seconds.values()),
        "peak_memory_mb": peak_memory_mb,
    }


COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#56B4E9")
MARKERS = {"draft": "o", "normal": "s", "high": "^"}


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """Colour: views, size: of the photographs, shape: quality."""
    rows = frames["rows"].sort_values("all_s")
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colour = dict(zip(sorted(rows.cameras.unique()), COLOURS, strict=False))
    sizes = {width: 20 + 25 * i for i, width in enumerate(sorted(rows.width.unique()))}
    for (cameras, width, quality), some in rows.groupby(["cameras", "width", "quality"]):
        look = {
            "color": colour[cameras],
            "s": sizes[width],
            "marker": MARKERS[str(quality)],
            "alpha": 0.8,
        }
        left.scatter(some.all_s, 1e3 * some.rms_m, **look)
        right.scatter(some.all_s, 100 * some.complete, **look)
    for cameras, name in colour.items():
        left.scatter([], [], color=name, label=f"{cameras} views")
    for quality, marker in MARKERS.items():
        left.scatter([], [], color="0.3", marker=marker, label=quality)
    for width, size in sizes.items():
        left.scatter([], [], color="0.7", s=size, label=f"{width} px wide")
    left.step(
        rows.all_s, 1e3 * rows.rms_m.cummin(), where="post", color="0.5", linewidth=0.8, zorder=0
    )
    left.set(
        xscale="log",
        yscale="log",
        xlabel="seconds, two cores",
        ylabel="RMS of the mesh in mm",
        title="error",
    )
    right.set(xscale="log", xlabel="seconds, two cores", ylabel="% of the radar's side within 1 mm")
    right.set_title("completeness")
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure


def main() -> None:
    """Measure, write the files of a study, print the table."""
    prog = "python -m tests.bench.studies.photogrammetry.measure_photogrammetry"
    purpose = (
        "what photogrammetry's accuracy costs in time, and whether its error bars are "
        "honest, on rendered hands"
    )
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "what", choices=list(CASES), help="what a ground truth is held to, or its price in time"
    )
    poses = (
        "letters or mesh files of hands, separated by commas; sweep takes the first (default C,Y)"
    )
    parser.add_argument("--poses", default="C,Y", help=poses)
    measured(parser, study, "photogrammetry")


if __name__ == "__main__":
    main()
