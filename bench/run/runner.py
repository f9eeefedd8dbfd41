"""Run a whole benchmark: every capture × method, from photographs and echoes to the table.

The steps are the functions of this module, in order. Each carries out stages (`bench.stages`),
whose results are kept in folders; a later step reads them there. Results do not depend on where the
stages are carried out. A stage that fails is reported and recorded, and the run goes on without
it.
"""

import random
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import tomlkit

from handbench.bench.benchmarks.benchmark_file import BenchFile, MethodEntry
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import INSPECTION
from handbench.bench.evaluation.scoring_protocols import REFERENCES
from handbench.bench.results.result_folder import Result, load
from handbench.bench.run.captures import Opened, RunCapture, open_captures, open_targets
from handbench.bench.run.engine import Chain, Engine, executor, process_count
from handbench.bench.run.write_result import (
    CONFIG,
    Imaged,
    RunOutcome,
    Surface,
    refined,
    registration_facts,
    write,
)
from handbench.bench.stages.calibrate import REGISTRATION, TARGET_QUALITY, calibrate, photographs
from handbench.bench.stages.foreign import foreign_stage
from handbench.bench.stages.image import configured
from handbench.bench.stages.quality import has_quality, measure_quality, quality_name
from handbench.bench.stages.reconstruct import DEPTH, reconstruct, repeat, time_again
from handbench.bench.stages.score import MEASURED, score_capture
from handbench.bench.validation.capture_warnings import inspect_capture, method_warnings
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.groundtruth import pipeline
from handbench.groundtruth.options import Quality
from handbench.groundtruth.pipeline import CLOUD, MESH
from handbench.radar.imaging.boxes import gather
from handbench.radar.imaging.device import current_device
from handbench.support.compiled import announce
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_text
from handbench.support.progress import counted
from handbench.support.store import Input, Stage, locked, read_sources

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
    base = base.resolve()
    read_sources()
    with locked(folder) as work, counted(0) as progress:
        _require_same(folder, work / CONFIG, config, overwrite)
        announce(gather)  # the processes say nothing
        engine = Engine(work.resolve(), progress)
        opened, targets = open_captures(engine, bench, base), open_targets(bench, base)
        shared, timed = stage_counts(bench, opened, targets)
        progress.total = shared + timed + sum("accuracy" in one.measures for one in opened)
        processes = process_count(sum(one.meshed for one in [*opened, *targets]))
        progress.abreast = None if scheduler else max(processes, 1)
        with executor(processes, scheduler) as engine.executor:
            made = prepare(engine, bench, opened, targets)
            progress.reach(shared)
            captures = [one.capture(engine.work) for one in opened if one.name in made["inspect"]]
            qualities = measure_groundtruth(engine, bench, captures)
            images = image(engine, bench, base, captures)
            progress.reach(shared + timed)
            registration = load_registration(engine.work, made["calibrate"])
            surfaces = find_references(engine, captures, made["mesh"], registration)
            scores = score(engine, bench, captures, images, surfaces)
        progress.reach(progress.total)
        warnings = read_warnings(engine.work, captures, made["inspect"])
        warnings |= method_warnings(
            (stage.method, image / DEPTH) for stage, image in images if stage.name == "reconstruct"
        )
        facts = {"warnings": warnings, "command": command, "refined_transforms": refined(surfaces)}
        rigs = [target.capture(engine.work) for target in targets]
        if registration is not None:
            facts |= registration_facts(registration, rigs[0])
        outcome = RunOutcome(
            bench=bench,
            captures=captures,
            targets=rigs,
            engine=engine,
            images=by_pair(images),
            qualities=qualities,
            references={name: tuple(of) for name, of in surfaces.items()},
            scores=scores,
            meshes={name: mesh.folder(engine.work) for name, mesh in made["mesh"].items()},
            facts={name: fact for name, fact in facts.items() if fact},
        )
        write(folder, outcome, config)
    return load(folder)


def stage_counts(
    bench: BenchFile, opened: Sequence[Opened], targets: Sequence[Opened]
) -> tuple[int, int]:
    """Return how many stages a run has before those that are timed, and how many are timed, if all
    of them succeed."""
    shared = sum(len(one.simulation) + 1 + 3 * one.meshed for one in opened)
    shared += sum(len(one.simulation) + 2 for one in targets) + bool(targets)
    timed = len(bench.groundtruth.sweep.quality) if bench.groundtruth.sweep else 0
    for one, entry in product(opened, bench.method):
        timed += ("accuracy" in one.measures) * (1 if entry.foreign else bench.rounds)
        timed += "precision" in one.measures and entry.precision and not entry.foreign
    return shared, timed


def _require_same(folder: Path, allowed: Path, config: str, overwrite: bool) -> None:
    """Raise a HandbenchError if the folder has the results of another configuration, and neither
    `overwrite` nor that of an earlier, interrupted run of this configuration allows to replace it.
    config: the text of this run's config.toml; allowed: the file that remembers it."""
    before = folder / CONFIG
    if overwrite:
        write_text(allowed, config)
    known = [file.read_text("utf-8", "replace") for file in (before, allowed) if file.exists()]
    if before.exists() and config not in known:
        raise HandbenchError(
            f"{folder}: has the results of another configuration; choose another folder, or "
            "replace them (--overwrite, in Python overwrite=True), which keeps finished stages"
        )


def prepare(
    engine: Engine, bench: BenchFile, opened: Sequence[Opened], targets: Sequence[Opened]
) -> dict[str, dict[str, Stage]]:
    """Simulate and inspect captures, reconstruct the photographs that are needed, and register
    camera and radar by the calibration target. Returns the stages that are finished: name → capture
    → stage. Raises HandbenchError if the calibration fails."""
    registration = registration_stages(engine.work, bench, targets)
    chains = [registration, *(capture_stages(engine, bench, one) for one in opened)]
    made = defaultdict[str, dict[str, Stage]](dict)
    for stage in engine.follow(chains, essential=[registration]):
        made[stage.name][stage.capture] = stage
    return made


def capture_stages(engine: Engine, bench: BenchFile, opened: Opened) -> Chain:
    """Yield the stages that precede the imaging of a capture, each when those before it are
    finished."""
    yield from opened.simulation
    capture = opened.capture(engine.work)
    asked = {"capture": capture.input, "frames": capture.frames}
    yield Stage(inspect_capture, asked, capture.name)
    if opened.meshed:
        with engine.attempt(capture.name, "photographs"):
            yield from photo_stages(engine.work, capture, bench.groundtruth.quality, bench.seed)


def registration_stages(work: Path, bench: BenchFile, targets: Sequence[Opened]) -> Chain:
    """Yield the stages that register camera and radar by the clouds of the calibration target, each
    when those before it are finished. work: folder of all stages."""
    arguments: dict[str, list[Input]] = {"captures": [], "clouds": []}
    for opened in targets:
        yield from opened.simulation
        target = opened.capture(work)
        sparse, dense, _ = photo_stages(work, target, TARGET_QUALITY, bench.seed)
        yield from (sparse, dense)
        arguments["captures"].append(target.input)
        arguments["clouds"].append(dense.output(work, CLOUD))
    if targets:
        yield Stage(calibrate, arguments, targets[0].name, shares=True)


def load_registration(work: Path, made: Mapping[str, Stage]) -> Transform | None:
    """Read the transform from the photo frame to the radar frame; None without a calibration.
    made: target → the stage that made it."""
    files = [stage.folder(work) / REGISTRATION for stage in made.values()]
    return load_transform(files[0]) if files else None


def read_warnings(
    work: Path, captures: Sequence[RunCapture], made: Mapping[str, Stage]
) -> dict[str, list[str]]:
    """Read the warnings of likely mistakes: capture → texts, for those that have some.
    made: capture → the stage that inspected it."""
    files = {c.name: made[c.name].folder(work) / INSPECTION for c in captures}
    warnings = {name: read_json(file, "warnings")["warnings"] for name, file in files.items()}
    return {name: texts for name, texts in warnings.items() if texts}


def photo_stages(work: Path, capture: RunCapture, quality: Quality, seed: int) -> PhotoStages:
    """Return the three stages that reconstruct a capture's photographs: cameras (sparse), point
    cloud (dense) and mesh. Raises HandbenchError if the capture has no photographs."""
    folder, options = photographs(capture.folder, quality, seed)
    return pipeline.stages(work, folder, options, [capture.key], capture=capture.name)


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
    meshes: Mapping[str, Stage],
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
        stages.append(Stage(score_capture, arguments, capture.name, shares=True))
    return {stage.capture: folder for stage, folder in engine.perform(stages).items()}
