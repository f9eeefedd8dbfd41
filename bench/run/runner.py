"""Run a whole benchmark: every capture × method, from photographs and echoes to the table.

The steps are the functions of this module, in order. Each carries out a round of stages
(`bench.stages`), whose results are kept in folders; a later step reads them there. Results do not
depend on where the stages are carried out. A stage that fails is reported and recorded, and the run
goes on without it.
"""

import random
from collections import defaultdict
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from handbench.bench.benchmarks.benchmark_file import BenchFile, MethodEntry
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import INSPECTION, TRUE_TRANSFORM
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.pipeline.image import configured
from handbench.bench.results.result_folder import Result, load
from handbench.bench.run.captures import RunCapture, open_captures, open_targets
from handbench.bench.run.engine import Engine
from handbench.bench.run.executors import executor
from handbench.bench.run.write_result import Imaged, RunOutcome, write
from handbench.bench.stages.calibrate import REGISTRATION, TARGET_QUALITY, calibrate, photographs
from handbench.bench.stages.foreign import foreign_stage
from handbench.bench.stages.quality import has_quality, measure_quality, quality_name
from handbench.bench.stages.reconstruct import DEPTH, reconstruct, repeat, time_again
from handbench.bench.stages.score import MEASURED, score_capture
from handbench.bench.validation.capture_warnings import inspect_capture
from handbench.calibration.registration.register import HAND_M
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.groundtruth import pipeline
from handbench.groundtruth.options import Quality
from handbench.groundtruth.pipeline import CLOUD, MESH
from handbench.radar.imaging.device import current_device
from handbench.radar.warmup import announce
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.folder import locked
from handbench.support.progress import counted
from handbench.support.store import Input, Stage, read_sources

Surface = tuple[Input, Transform]  # a mesh file, and the transform into the radar frame
PhotoStages = tuple[Stage, Stage, Stage]  # sparse, dense and mesh of one capture's photographs


def run(
    bench: BenchFile,
    base: Path,
    folder: Path,
    overwrite: bool = False,
    scheduler: str | None = None,
    command: str | None = None,
) -> Result:
    """Run a benchmark into a result folder, and return the result read from it.
    base: folder to which the benchmark's paths are relative. Stages that `folder` already has are
    reused. overwrite: replace the results of another configuration. scheduler: address of a Dask
    scheduler whose workers see both folders under the same paths; None: run on this machine.
    command: the command line that repeats the run, for the report.
    Raises HandbenchError if the folder has the results of another benchmark, or every capture
    fails."""
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    base, plan = base.resolve(), stage_counts(bench)
    read_sources()
    with locked(folder) as work, executor(scheduler) as elsewhere, counted(sum(plan)) as progress:
        _require_same(folder, config, overwrite)
        announce()  # the processes say nothing
        engine = Engine(work.resolve(), elsewhere, progress, plan)
        captures = open_captures(engine, bench, base)
        targets = open_targets(engine, bench, base)
        warnings = inspect(engine, captures)
        meshes, registration = reconstruct_photographs(engine, bench, captures, targets)
        qualities = measure_groundtruth(engine, bench, captures)
        images = image(engine, bench, base, captures)
        surfaces = find_references(engine, captures, meshes, registration)
        scores = score(engine, bench, captures, images, surfaces)
        facts = {"warnings": warnings, "command": command, "refined_transforms": refined(surfaces)}
        if registration is not None:
            facts |= registration_facts(registration, targets[0])
        outcome = RunOutcome(
            bench=bench,
            captures=captures,
            targets=targets,
            engine=engine,
            images=by_pair(images),
            qualities=qualities,
            references={name: tuple(of) for name, of in surfaces.items()},
            scores=scores,
            meshes={name: mesh.folder(engine.work) for name, mesh in meshes.items()},
            facts={name: fact for name, fact in facts.items() if fact},
        )
        write(folder, outcome, config)
    return load(folder)


def stage_counts(bench: BenchFile) -> list[int]:
    """Return how many stages each round of a run has at most, for its progress."""
    captures, targets = len(bench.capture), len(bench.calibration)
    accurate = sum("accuracy" in source.measures for source in bench.capture)
    photographs = [accurate + targets] * 2 + [accurate + bool(targets)]
    qualities = len(bench.groundtruth.sweep.quality) if bench.groundtruth.sweep else 0
    images = sum(
        ("accuracy" in source.measures) + ("precision" in source.measures and entry.precision)
        for source, entry in product(bench.capture, bench.method)
    )
    timed = [accurate * len(bench.method)] * (bench.rounds - 1)
    return [captures, targets, captures, *photographs, qualities, images, *timed, accurate]


def _require_same(folder: Path, config: str, overwrite: bool) -> None:
    """Raise a HandbenchError if the folder has the results of another configuration and `overwrite`
    is false.
    config: the text of this run's config.toml."""
    before = folder / "config.toml"
    if before.exists() and before.read_text("utf-8", "replace") != config and not overwrite:
        raise HandbenchError(
            f"{folder}: has the results of another configuration; choose another folder, or "
            "replace them (--overwrite, in Python overwrite=True), which keeps finished stages"
        )


def inspect(engine: Engine, captures: Sequence[RunCapture]) -> dict[str, list[str]]:
    """Check all captures for likely mistakes, which are printed. Returns the warnings: capture →
    texts."""
    stages = [Stage(inspect_capture, {"capture": c.input}, c.name) for c in captures]
    warnings = {
        stage.capture: read_json(folder / INSPECTION, "warnings")["warnings"]
        for stage, folder in engine.perform(stages).items()
    }
    return {name: texts for name, texts in warnings.items() if texts}


def reconstruct_photographs(
    engine: Engine, bench: BenchFile, captures: Sequence[RunCapture], targets: Sequence[RunCapture]
) -> tuple[dict[str, Stage], Transform | None]:
    """Reconstruct all photographs that are needed: cameras, then point clouds, then the mesh of
    each capture; and register camera and radar by the clouds of the calibration target.
    Returns capture → the stage that made its mesh, and the transform from the photo frame to the
    radar frame, None without a calibration. Raises HandbenchError if the calibration fails."""
    of_targets = [photo_stages(engine, t, TARGET_QUALITY, bench.seed) for t in targets]
    chains, quality = list(of_targets), bench.groundtruth.quality
    for capture in captures:
        with engine.attempt(capture.name, "photographs"):
            if capture.accurate and needs_mesh(capture, bench):
                chains.append(photo_stages(engine, capture, quality, bench.seed))
    for number in range(2):  # sparse, dense
        essential = [chain[number] for chain in of_targets]
        folders = engine.perform([chain[number] for chain in chains], essential)
        chains = [chain for chain in chains if chain[number] in folders]
    clouds = [dense.output(engine.work, CLOUD) for _, dense, _ in of_targets]
    arguments = {"captures": [target.input for target in targets], "clouds": clouds}
    calibration = [Stage(calibrate, arguments, targets[0].name, shares=True)] if targets else []
    meshes = [mesh for _, _, mesh in chains[len(targets) :]]
    folders = engine.perform([*calibration, *meshes], calibration)
    registrations = [load_transform(folders[one] / REGISTRATION) for one in calibration]
    finished = {mesh.capture: mesh for mesh in meshes if mesh in folders}
    return finished, registrations[0] if registrations else None


def photo_stages(engine: Engine, capture: RunCapture, quality: Quality, seed: int) -> PhotoStages:
    """Return the three stages that reconstruct a capture's photographs: cameras (sparse), point
    cloud (dense) and mesh. Raises HandbenchError if the capture has no photographs."""
    folder, options = photographs(capture.folder, quality, seed)
    return pipeline.stages(engine.work, folder, options, [capture.key], capture=capture.name)


def needs_mesh(capture: RunCapture, bench: BenchFile) -> bool:
    """Tell whether a capture's photographs have to be reconstructed: it has some, it has no mesh,
    and the capture or the benchmark's calibration gives a transform into the radar frame."""
    data = open_capture(capture.folder)
    carried = bool(bench.calibration) or data.transform() is not None
    return carried and data.photos is not None and data.mesh() is None


def measure_groundtruth(
    engine: Engine, bench: BenchFile, captures: Sequence[RunCapture]
) -> list[Imaged]:
    """Reconstruct the photographs of one capture by every setting of the ground truth's sweep, one
    after the other, because their time is a result. Returns the finished stages with their
    folders."""
    sweep, stages = bench.groundtruth.sweep, list[Stage]()
    fitting = (capture for capture in captures if has_quality(capture.folder))
    if sweep is not None and (capture := next(fitting, None)) is not None:
        for quality in sweep.quality:
            arguments = {"capture": capture.input, "quality": quality, "seed": bench.seed}
            stage = Stage(measure_quality, arguments, capture.name, quality_name(quality))
            stages.append(stage)
    return list(engine.perform(stages).items())


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


def image(
    engine: Engine, bench: BenchFile, base: Path, captures: Sequence[RunCapture]
) -> list[Imaged]:
    """Image every capture by every method, one after the other, because their time is a result.
    Several rounds are shuffled, so that a machine that becomes slower affects all methods equally.
    Returns the finished stages with their folders."""
    images: list[Imaged] = []
    for number in range(bench.rounds):
        failed = {(failure.capture, failure.method) for failure in engine.failures}
        stages: list[Stage] = []
        for capture, entry in product(captures, bench.method):
            if (capture.name, entry.label) not in failed:
                with engine.attempt(capture.name, "reconstruct", entry.label):
                    stages += imaging_stages(bench, base, capture, entry, number)
        if bench.rounds > 1:
            random.Random(f"{bench.seed} {number}").shuffle(stages)
        images += engine.perform(stages).items()
    return images


def by_pair(images: Sequence[Imaged]) -> dict[tuple[str, str], list[Imaged]]:
    """Return the stages of imaging by capture and method; none for other pairs."""
    pairs = defaultdict[tuple[str, str], list[Imaged]](list)
    for stage, folder in images:
        pairs[stage.capture, stage.method].append((stage, folder))
    return pairs


def imaging_stages(
    bench: BenchFile, base: Path, capture: RunCapture, entry: MethodEntry, round_: int
) -> list[Stage]:
    """Return the stages that image a capture by one method.
    For the accuracy, one stage images the first `frames` frames of the benchmark. For the
    precision, another images `repeats` frames, if both the capture and the method measure it. In a
    further round, the first is only timed again. base: folder to which the benchmark's paths are
    relative."""
    if entry.foreign:
        once = capture.accurate and round_ == 0
        return [foreign_stage(bench, base, capture.input, capture.about, entry)] if once else []
    arguments = {
        "capture": capture.input,
        "method": entry.id,
        "config": configured(capture.about, entry.id, entry.config).model_dump(mode="json"),
        "device": current_device(),
        "every_nth_antenna": entry.every_nth_antenna,
    }
    frames, names = {"frames": bench.frames}, (capture.name, entry.label)
    if round_:
        again = Stage(time_again, arguments | frames | {"round_": round_}, *names)
        return [again] if capture.accurate else []
    stages = [Stage(reconstruct, arguments | frames, *names)] if capture.accurate else []
    if "precision" in capture.measures and entry.precision:
        stages.append(Stage(repeat, arguments | {"frames": bench.repeats}, *names))
    return stages


def find_references(
    engine: Engine,
    captures: Sequence[RunCapture],
    meshes: dict[str, Stage],
    registration: Transform | None,
) -> dict[str, dict[str, Surface]]:
    """Find for each capture the surfaces with which its depth maps are compared: capture →
    reference → surface. A capture without any is recorded as a failure.
    meshes: capture → stage that made a mesh of its photographs. registration: transform from the
    photo frame to the radar frame, for captures that have none."""
    failed = {failure.capture for failure in engine.failures if not failure.method}
    surfaces: dict[str, dict[str, Surface]] = {}
    for capture in (c for c in captures if c.accurate and c.name not in failed):
        mesh = meshes.get(capture.name)
        made = None if mesh is None else mesh.output(engine.work, MESH)
        with engine.attempt(capture.name, "references"):
            surfaces[capture.name] = references(capture, registration, made)
    return surfaces


def references(
    capture: RunCapture, registration: Transform | None, made: Input | None
) -> dict[str, Surface]:
    """Find the surfaces with which a capture's depth maps are compared: reference → mesh file, and
    the transform that moves the mesh into the radar frame.
    made: mesh of the capture's photographs. Raises HandbenchError if there is no surface."""
    available: dict[str, Surface] = {}
    data = open_capture(capture.folder)
    transform, mesh = data.transform() or registration, data.mesh()
    measured = made if mesh is None else Input(str(mesh), capture.key)
    if transform is not None and measured is not None:
        available[MEASURED] = measured, transform
    if data.truth is not None:
        available["truth"] = Input(str(data.truth), capture.key), identity("radar")
        if MEASURED in available:
            available["completed"] = available[MEASURED]
    if not available:
        raise HandbenchError(
            f"{capture.folder}: has no surface to compare depths with; add photographs or "
            "mesh.ply with a transform (radar_from_photo.json, or [calibration] in the "
            "benchmark)"
        )
    return {name: available[name] for name in REFERENCES if name in available}


def refined(surfaces: dict[str, dict[str, Surface]]) -> dict[str, str]:
    """Return the captures whose transform was refined by depth maps: capture → the reason."""
    measured = {name: of[MEASURED][1] for name, of in surfaces.items() if MEASURED in of}
    return {name: t.refined for name, t in measured.items() if t.refined}


def score(
    engine: Engine,
    bench: BenchFile,
    captures: Sequence[RunCapture],
    images: Sequence[Imaged],
    surfaces: dict[str, dict[str, Surface]],
) -> dict[str, Path]:
    """Compare the depth maps of all captures with their references. Returns capture → folder with
    the scores."""
    maps = {
        (stage.capture, stage.method): stage.output(engine.work, DEPTH)
        for stage, _ in images
        if stage.name == "reconstruct"
    }
    stages = []
    for capture in (c for c in captures if c.name in surfaces):
        labels = [entry.label for entry in bench.method if (capture.name, entry.label) in maps]
        if not labels:
            continue
        carried = {
            name: [mesh, Input(transform, [transform.matrix, transform.covariance])]
            for name, (mesh, transform) in surfaces[capture.name].items()
        }
        arguments = {
            "capture": capture.input,
            "maps": {label: maps[capture.name, label] for label in labels},
            "references": carried,
            "protocol": bench.protocol,
        }
        stages.append(Stage(score_capture, arguments, capture.name))
    return {stage.capture: folder for stage, folder in engine.perform(stages).items()}
