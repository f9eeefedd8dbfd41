"""Write the result folder of a run: the scores of the captures, the table made of them, and all
maps."""

import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.benchmarks.benchmark_file import BenchFile, MethodEntry
from handbench.bench.datasets.native import TRUE_TRANSFORM
from handbench.bench.evaluation.combine import PER_PIXEL, STRONGEST
from handbench.bench.evaluation.intervals import note
from handbench.bench.evaluation.metrics import figures
from handbench.bench.evaluation.scoring_protocols import main_table, protocol
from handbench.bench.evaluation.tables import SCORES, TASKS, frame, read
from handbench.bench.results.about import About, CaptureFacts, MethodFacts, metric_facts
from handbench.bench.results.derived import few_pixels
from handbench.bench.results.maps import Frames, depth_path, errors_path, photo_path, write_frames
from handbench.bench.results.result_folder import TABLES, write_about, write_tables
from handbench.bench.run.captures import CommonSubset, RunCapture, common_subset
from handbench.bench.run.engine import Engine
from handbench.bench.stages.quality import QUALITY
from handbench.bench.stages.reconstruct import (
    DEPTH,
    VELOCITY,
    read_frames,
    read_repeats,
    read_times,
)
from handbench.bench.stages.score import MEASURED, SCORED, SIGMA
from handbench.calibration.registration import HAND_M
from handbench.calibration.transforms import Transform, load_transform
from handbench.groundtruth.pictures import ORIENTATION, open_picture
from handbench.groundtruth.pipeline import VIEW
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.imaging.device import describe
from handbench.support.cost import machine
from handbench.support.files import atomic_path, read_json, write_text
from handbench.support.progress import say
from handbench.support.store import Input, Stage, drop, versions

PHOTO_PX = 600
CONFIG = "config.toml"
FILES = (
    "result.json",
    CONFIG,
    "errors",
    "depth",
    "frames",
    "photos",
    *(f"{name}.csv" for name in TABLES),
)
Imaged = tuple[Stage, Path]  # a finished stage of imaging, and its folder
Surface = tuple[Input, Transform]  # a mesh file, and the transform into the radar frame


@dataclass(frozen=True)
class RunOutcome:
    """Everything that a run made.
    targets: captures of the calibration target. engine: what the stages cost, and which failed.
    images: (capture, method) → the finished stages that imaged it; qualities: those of the ground
    truth's sweep. references: capture → names of its references. scores: capture → folder of its
    scores. meshes: capture → folder with the mesh of its photographs. facts: of result.json."""

    bench: BenchFile
    captures: list[RunCapture]
    targets: list[RunCapture]
    engine: Engine
    images: Mapping[tuple[str, str], list[Imaged]]
    qualities: list[Imaged]
    references: dict[str, tuple[str, ...]]
    scores: dict[str, Path]
    meshes: dict[str, Path]
    facts: dict[str, Any]


def write(folder: Path, outcome: RunOutcome, config: str) -> None:
    """Collect the scores of all captures and methods of the table, and write the result folder.
    Earlier results are replaced only when the new ones are complete; result.json, which marks the
    folder as complete, is written last. config: text of config.toml. Raises HandbenchError if every
    capture failed."""
    bench, failures = outcome.bench, outcome.engine.failures
    subset = common_subset(bench, outcome.captures, failures)
    if failures:
        say(f"the table uses {subset.text}")
    scores = collect_scores(outcome, subset)
    # a stage's scores may be kept from a benchmark with another order of its methods
    order = [entry.label for entry in subset.methods]
    of_table = scores[scores.method.isin(order)]
    ordered = of_table.sort_values("method", key=lambda m: m.map(order.index), kind="stable")
    table = main_table(ordered, protocol(bench.protocol), bench.seed, bool(bench.reproduces))
    drop(folder, FILES)
    for capture, entry in product(subset.captures, subset.methods):
        _copy_maps(folder, outcome, capture.name, entry.label)
    for capture in subset.captures:
        for reference in outcome.references[capture.name]:
            at = depth_path(Path(), capture.name, reference)
            _copy(outcome.scores[capture.name] / at, folder / at)
        if capture.name in outcome.meshes:
            write_photo(folder, capture.name, outcome.meshes[capture.name] / VIEW)
    write_text(folder / CONFIG, config)
    captures = capture_facts(outcome, subset.all_captures)
    text = subset.text
    if few := few_pixels(scores, [c for c in captures if "accuracy" in c.measures]):
        text += f"; {few}"
        say(few)
    write_tables(folder, table=table, tasks=frame(TASKS, outcome.engine.tasks), scores=scores)
    write_about(folder, about(outcome, subset, captures, text))


def _copy_maps(folder: Path, outcome: RunOutcome, capture: str, method: str) -> None:
    """Copy a method's depth map of a capture and its errors into the result folder, and write the
    depths and velocities of all frames."""
    images = outcome.images[capture, method]
    [imaged] = [made for stage, made in images if stage.name == "reconstruct"]
    _copy(imaged / DEPTH, depth_path(folder, capture, method))
    if frames := _frames(imaged):
        write_frames(folder, capture, method, frames)
    for reference in outcome.references[capture]:
        at = errors_path(Path(), capture, method, reference)
        _copy(outcome.scores[capture] / at, folder / at)


def _copy(source: Path, path: Path) -> None:
    with atomic_path(path) as temporary:
        shutil.copyfile(source, temporary)


def _frames(imaged: Path) -> Frames | None:
    """Read the depths and velocities of all frames from the folder of an imaging stage; None if
    there is a single frame, or no velocities or times of the frames."""
    maps, times = read_frames(imaged, load_depthmap(imaged / DEPTH)), read_times(imaged)
    if not maps or maps[0].velocity_m_s is None or "frame_times_s" not in times:
        return None
    z_m, velocity_m_s = (np.stack([getattr(m, n) for m in maps]) for n in ("z_m", VELOCITY))
    starts_s = np.array(times["frame_times_s"], np.float64)
    return Frames(maps[0].x_m, maps[0].y_m, z_m, velocity_m_s, starts_s)


def collect_scores(outcome: RunOutcome, subset: CommonSubset) -> pd.DataFrame:
    """Collect the table of scores (SCORES) of the captures and methods that the result contains.
    Its lines are the figures of each capture, from its scoring stage; the time of each image; and
    for the precision, the depth of the strongest scatterer in each repeated frame, and the median
    over the pixels of their standard deviations."""
    labels = [entry.label for entry in subset.methods]
    rows: list[tuple[Any, ...]] = []
    pixels: list[tuple[Any, ...]] = []
    for capture, method in product((capture.name for capture in subset.repeated), labels):
        for stage, folder in outcome.images[capture, method]:
            if stage.name != "repeat":
                continue
            strongest_z_m, deviations = read_repeats(folder)
            rows += [
                (capture, method, "", "", number, STRONGEST, float(z_m))
                for number, z_m in enumerate(strongest_z_m)
            ]
            median_mm = figures(deviations)["median_mm"]
            pixels.append((capture, method, "", "", 0, PER_PIXEL, median_mm))
    rows += pixels
    for capture, method in product((capture.name for capture in subset.all_captures), labels):
        seconds = [
            value
            for _, folder in outcome.images[capture, method]
            for value in read_times(folder)["seconds"]
        ]
        rows += [(capture, method, "", "", n, "seconds", value) for n, value in enumerate(seconds)]
    of_captures = [read(outcome.scores[c.name] / SCORED, SCORES) for c in subset.captures]
    scores = pd.concat([frame(SCORES), *of_captures, frame(SCORES, rows)], ignore_index=True)
    qualities = frame(SCORES, _quality_scores(outcome.qualities))
    return pd.concat([scores[scores.method.isin(labels)], qualities], ignore_index=True)


def _quality_scores(qualities: Iterable[Imaged]) -> list[tuple[Any, ...]]:
    """Return the lines of the table of scores for the settings of the ground truth's sweep."""
    return [
        (stage.capture, stage.method, "truth", "", 0, metric, value)
        for stage, folder in qualities
        for metric, value in read_json(folder / QUALITY, "the quality of a surface").items()
    ]


def capture_facts(outcome: RunOutcome, captures: Iterable[RunCapture]) -> tuple[CaptureFacts, ...]:
    """Return the facts of the result's captures that result.json records, such as pose and
    distance."""
    return tuple(
        CaptureFacts(
            name=capture.name,
            measures=capture.measures,
            pose=capture.about.pose,
            distance_m=capture.about.distance_m,
            references=references,
            own_mesh=MEASURED in references and capture.name not in outcome.meshes,
            effects=capture.about.effects,
        )
        for capture in captures
        for references in [outcome.references.get(capture.name, ())]
    )


def about(
    outcome: RunOutcome, subset: CommonSubset, captures: tuple[CaptureFacts, ...], basis: str
) -> About:
    """Make the content of result.json: protocol, inputs, machine, captures, methods, facts,
    failures. captures: facts of the captures; basis: words that say on what the table is based."""
    bench = outcome.bench
    inputs = {capture.name: capture.key for capture in outcome.captures}
    inputs |= {f"calibration {target.name}": target.key for target in outcome.targets}
    sigmas = {
        capture.name: read_json(outcome.scores[capture.name] / SIGMA, "a reference's σ")
        for capture in subset.captures
        if MEASURED in outcome.references[capture.name]
    }
    facts = {"intervals": note(len(subset.captures)), "phase_noise_rad": bench.phase_noise_rad}
    return About(
        name=bench.name,
        protocol={
            **protocol(bench.protocol).about(),
            "basis": basis,
            "repeats": bench.repeats,
            "seed": bench.seed,
        },
        metrics=metric_facts(),
        inputs=inputs,
        versions=versions(),
        machine=_machines(outcome.engine),
        captures=captures,
        methods=tuple(_method_facts(outcome, subset, entry) for entry in subset.methods),
        facts=outcome.facts | facts | ({"groundtruth_sigma_rms": sigmas} if sigmas else {}),
        failures=tuple(outcome.engine.failures),
    )


def registration_facts(registration: Transform, target: RunCapture) -> dict[str, Any]:
    """Return facts of the registration for result.json: its residuals, mm; and its error at the
    position of a hand, mm, if the true transform is known."""
    residuals_mm = [1e3 * float(residual_m) for residual_m in registration.residuals_m]
    facts: dict[str, Any] = {"registration_residuals_mm": residuals_mm}
    true = target.folder / TRUE_TRANSFORM
    if true.exists():
        hand_m = registration.points(load_transform(true).inverse().points(HAND_M))
        facts["registration_error_at_hand_mm"] = 1e3 * float(np.linalg.norm(hand_m - HAND_M))
    return facts


def refined(surfaces: dict[str, dict[str, Surface]]) -> dict[str, str]:
    """Return the captures whose transform was refined by depth maps: capture → the reason."""
    measured = {name: of[MEASURED][1] for name, of in surfaces.items() if MEASURED in of}
    return {name: t.refined for name, t in measured.items() if t.refined}


def _method_facts(outcome: RunOutcome, subset: CommonSubset, entry: MethodEntry) -> MethodFacts:
    """Return a method's facts for result.json, with its complete configuration on each capture."""
    names = [capture.name for capture in subset.all_captures]
    images = {name: outcome.images[name, entry.label] for name in names}
    config = {name: images[name][0][0].arguments["config"] for name in names if images[name]}
    return MethodFacts(
        name=entry.label, id=entry.id, title=entry.title or entry.label, config=config
    )


def _machines(engine: Engine) -> dict[str, Any]:
    """Return facts of this machine and of all others that did some of the work."""
    here = machine()
    others = {name: facts for name, facts in engine.machines.items() if name != here["host"]}
    return {**here, "imaging_device": describe(), **({"others": others} if others else {})}


def write_photo(folder: Path, capture: str, source: str | Path) -> None:
    """Write the photograph `source` into a result folder, as a small JPEG, upright and without
    metadata."""
    from PIL import Image, ImageOps

    with open_picture(Path(source)) as image:
        orientation = image.getexif().get(ORIENTATION, 1)
        small = Image.fromarray(np.asarray(image.convert("RGB")))
    if orientation in range(2, 9):  # only this: Pillow cannot write all other EXIF data
        small.getexif()[ORIENTATION] = int(orientation)
        small = ImageOps.exif_transpose(small)
    small.thumbnail((PHOTO_PX, PHOTO_PX))
    with atomic_path(photo_path(folder, capture)) as temporary:
        Image.fromarray(np.asarray(small)).save(temporary, quality=88)
