"""The main job: every capture × method of a benchmark, from photographs and echoes to the table.

The stages run in the rounds of `bench.run.jobs`. Whoever carries them out, the folders are the same, and the
table is made of these. What fails is said, recorded and done without.
"""

from dataclasses import dataclass, field, replace
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from handbench.bench import results
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import DOUBTS, TRUE_TRANSFORM
from handbench.bench.results import REFERENCES, Failure
from handbench.bench.run import jobs as plan
from handbench.bench.run import outcome, planned_cost, write_result
from handbench.bench.run.benchmark_file import BenchFile, Origin, Source
from handbench.bench.run.calibrate_stage import REGISTRATION
from handbench.bench.run.executors import Executor, executor
from handbench.bench.run.outcome import Capture, Outcome, failing
from handbench.bench.run.reconstruct_stage import DEPTH, TIMING
from handbench.bench.run.repeat_stage import read_repeats
from handbench.bench.run.simulate_stage import CAPTURE
from handbench.bench.run.tasks import HASH, Done
from handbench.calibration.registration.register import HAND_M
from handbench.calibration.transforms import Transform, identity, load_transform
from handbench.groundtruth.mesh_stage import MESH, VIEW
from handbench.support.cost import require_time
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.folder import claimed
from handbench.support.progress import say
from handbench.support.store import Stage, Stamp


def run(
    bench: BenchFile,
    base: Path,
    folder: Path,
    overwrite: bool = False,
    scheduler: str | None = None,
    command: str | None = None,
) -> results.Result:
    """Run a benchmark whose paths start from `base` into a result folder; stages done before are taken from there.

    scheduler: address of a Dask scheduler whose workers find both folders under the same paths; None: run here.
    command: what repeats the run, for the report.
    """
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    ahead = planned_cost.Work(0.0)
    if scheduler is None:  # of other machines neither cores nor memory are known
        ahead = planned_cost.of_run(bench, base)
        require_time(ahead.core_s, f"{len(bench.capture)} captures × {len(bench.method)} methods", ahead.bytes_)
    with claimed(folder) as work, executor(scheduler, ahead.core_s, ahead.bytes_) as workers:
        _check_room(folder, config, overwrite)
        found = Run(bench, base.resolve(), work.resolve(), workers).execute()
        found.facts |= {} if command is None else {"command": command}
        write_result.write(folder, found, config)
        del found  # it would lie in memory beside what is read
    return results.load(folder)


def _check_room(folder: Path, config: str, overwrite: bool) -> None:
    """Refuse to mix with another benchmark's results."""
    before = folder / "config.toml"
    if before.exists() and before.read_text("utf-8", "replace") != config and not overwrite:
        raise HandbenchError(
            f"{folder}: holds the results of another configuration; choose another -o, or --overwrite to replace them"
        )


@dataclass
class Run:
    """A benchmark at work; paths start from `base`, the stages' folders lie under `work`."""

    bench: BenchFile
    base: Path
    work: Path
    executor: Executor
    tasks: list[outcome.Line] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    machines: dict[str, dict[str, Any]] = field(default_factory=dict)

    def execute(self) -> Outcome:
        """The list of steps."""
        captures, targets = self.open()
        found = Outcome(self.bench, captures, self.tasks, self.failures, machines=self.machines)
        found.facts |= self.inspected(captures)
        clouds = [plan.clouds(self.bench, target, self.work) for target in targets]
        stages = [] if not targets else [plan.calibration(targets, [dense for _, dense, _ in clouds], self.work)]
        for capture in (c for c in captures if "accuracy" in c.measures):
            with failing(self.failures, capture.name, "photographs"):
                if (meshed := plan.meshing(self.bench, capture, self.work)) is not None:
                    clouds.append(meshed)
        stages += self.reconstructed(clouds, len(targets))
        for capture, entry in product(captures, self.bench.method):
            with failing(self.failures, capture.name, "reconstruct", entry.id):
                stages += plan.imaging(self.bench, self.base, capture, entry)
        meshes: dict[str, Path] = {}
        registration = None
        for stage, done in zip(stages, self.perform(stages), strict=True):
            if stage.name == "calibrate":
                registration = self.registration(stage, done, targets, found)
            elif done.failure is None and stage.name == "mesh":
                meshes[stage.capture] = stage.folder(self.work)
            elif done.failure is None:
                collect(stage, stage.folder(self.work), found)
        self.score(found, registration, meshes)
        return found

    def inspected(self, captures: list[Capture]) -> dict[str, Any]:
        """The doubts about each capture that has some, as a fact of the result; said when they are found."""
        stages = [plan.inspection(capture) for capture in captures]
        ended = zip(stages, self.perform(stages), strict=True)
        files = {stage.capture: stage.folder(self.work) / DOUBTS for stage, done in ended if done.failure is None}
        doubts = {name: read_json(file, "doubts")["doubts"] for name, file in files.items()}
        return {"doubts": told} if (told := {name: texts for name, texts in doubts.items() if texts}) else {}

    def reconstructed(self, clouds: list[plan.Clouds], targets: int) -> list[Stage]:
        """The rounds of the photographs, sparse and dense; returned are the stages that then make the meshes. The
        first `targets` of the clouds are the calibration's, without which nothing goes on, and which need no mesh."""
        for round_ in range(2):
            ended = self.perform([stages[round_] for stages in clouds])
            for done in ended[:targets]:
                if done.failure is not None:
                    raise HandbenchError(f"calibration: {done.failure}")
            clouds = [stages for stages, done in zip(clouds, ended, strict=True) if done.failure is None]
        return [mesh for _, _, mesh in clouds[targets:]]

    def score(self, found: Outcome, registration: Transform | None, meshes: dict[str, Path]) -> None:
        """The last round: the captures that have a reference and a depth map; meshes: folders of those that were
        made."""
        without, stages = {failure.capture for failure in self.failures if not failure.method}, []
        for capture in (c for c in found.captures if "accuracy" in c.measures and c.name not in without):
            name = capture.name
            with failing(self.failures, name, "references"):
                found.references[name] = references(capture, registration, meshes.get(name), found)
            imaged = ((entry.id, found.maps.get((name, entry.id))) for entry in self.bench.method)
            maps = {method: file for method, file in imaged if file is not None}
            if maps and name in found.references:
                stages.append(plan.scoring(self.bench, capture, maps, found.references[name]))
        for stage, done in zip(stages, self.perform(stages), strict=True):
            if done.failure is None:
                found.scores[stage.capture] = stage.folder(self.work)

    def perform(self, stages: list[Stage]) -> list[Done]:
        """Have independent stages carried out; outcomes are returned and recorded in the order of the list."""
        ended: dict[int, Done] = {}
        failures: dict[int, Failure] = {}
        tasks: dict[int, outcome.Line] = {}
        machines: dict[str, tuple[int, dict[str, Any]]] = {}  # of the first stage of the list that each made
        for number, done in self.executor.run(self.work, stages):
            stage, stamp = stages[number], done.stamp
            ended[number] = replace(done, stamp=None)  # its line is kept: ten thousand stamps are 12 MB
            if stamp is not None:
                say(f"{stage.label}: " + ("cached" if done.cached else f"{stamp.seconds:.1f} s"))
                tasks[number] = _task(stage, stamp, done.cached, stage.folder(self.work))
                host = stamp.machine.get("host", "")
                machines[host] = min((number, stamp.machine), machines.get(host, (len(stages), {})), key=itemgetter(0))
            if done.failure is not None:
                failed = Failure(capture=stage.capture, method=stage.method, stage=stage.name, message=done.failure)
                failures[number] = failed
                say(failed.line)
        self.failures += [failures[number] for number in sorted(failures)]
        self.tasks += [tasks[number] for number in sorted(tasks)]
        for host, (_, machine) in sorted(machines.items(), key=itemgetter(1)):
            self.machines.setdefault(host, machine)
        return [ended[number] for number in range(len(stages))]

    def open(self) -> tuple[list[Capture], list[Capture]]:
        """The first round: those of the benchmark's captures that can be opened, and all of the calibration's."""
        opening: list[tuple[Origin, Stage]] = []
        for source in self.bench.capture:
            with failing(self.failures, source.scene or source.path or "", "open"):
                frames = self.bench.frames_of(source)
                stage = plan.opening(self.bench, self.base, source, frames, photos="accuracy" in source.measures)
                opening.append((source, stage))
        names = [stage.capture for _, stage in opening]
        if twice := [name for name in names if names.count(name) > 1]:
            raise HandbenchError(f"capture: two captures are named '{twice[0]}'; give each its own name")
        for target in self.bench.calibration:
            opening.append((target, plan.opening(self.bench, self.base, target, frames=1)))
        captures: list[Capture] = []
        targets: list[Capture] = []
        for (origin, stage), done in zip(opening, self.perform([stage for _, stage in opening]), strict=True):
            if done.failure is not None:
                if not isinstance(origin, Source):
                    raise HandbenchError(f"calibration: {done.failure}")
                continue
            folder = Path(stage.arguments["folder"]) if stage.name == HASH else stage.folder(self.work) / CAPTURE
            about = open_capture(folder).about
            if isinstance(origin, Source):
                captures.append(Capture(folder, done.key, about, origin.measures))
            else:
                targets.append(Capture(folder, done.key, about))
        return captures, targets

    def registration(self, stage: Stage, done: Done, targets: list[Capture], found: Outcome) -> Transform:
        """radar_from_photo from the benchmark's target captures; without it nothing has a reference."""
        if done.failure is not None:
            raise HandbenchError(f"calibration: {done.failure}")
        transform = load_transform(stage.folder(self.work) / REGISTRATION)
        found.inputs |= {f"calibration {target.name}": target.key for target in targets}
        found.facts["registration_residuals_mm"] = (1e3 * transform.residuals_m).tolist()
        true = targets[0].folder / TRUE_TRANSFORM
        if true.exists():
            found_m = transform.points(load_transform(true).inverse().points(HAND_M))
            found.facts["registration_error_at_hand_mm"] = 1e3 * float(np.linalg.norm(found_m - HAND_M))
        return transform


def collect(stage: Stage, folder: Path, found: Outcome) -> None:
    """Collect the files that an imaging stage has left in its folder."""
    about = stage.capture, stage.method
    times = read_json(folder / TIMING, "a stage's times")["seconds"]
    found.seconds.setdefault(about, []).extend(times)
    found.configs[about] = stage.arguments["config"]
    if stage.name == "reconstruct":
        found.maps[about] = folder / DEPTH
    else:
        strongest_m, _ = read_repeats(folder)
        found.deviations[about] = folder
        found.repeats += [(*about, k, float(z)) for k, z in enumerate(strongest_m)]


def references(
    capture: Capture, registration: Transform | None, made: Path | None, found: Outcome
) -> dict[str, tuple[Path, Transform]]:
    """Reference name → mesh file and the transform that carries it into the radar frame. made: the folder with the mesh
    of the capture's photographs."""
    available: dict[str, tuple[Path, Transform]] = {}
    data = open_capture(capture.folder)
    transform, mesh = data.transform() or registration, data.mesh()
    if transform is not None and transform.refined:
        found.facts.setdefault("refined_transforms", {})[capture.name] = transform.refined["reason"]
    if transform is not None and transform.note:
        found.facts.setdefault("transform_notes", {})[capture.name] = transform.note
    if transform is not None and mesh is not None:
        available["photogrammetry"] = mesh, transform
    elif transform is not None and made is not None:
        available["photogrammetry"] = made / MESH, transform
        found.views[capture.name] = made / VIEW
    if data.truth is not None:
        available["truth"] = data.truth, identity("radar")
        if "photogrammetry" in available:
            available["completed"] = available["photogrammetry"]
    if not available:
        raise HandbenchError(
            f"{capture.folder}: nothing to score against; expected photographs or mesh.ply with a transform "
            "(radar_from_photo.json or the benchmark's [calibration]), or truth.ply"
        )
    return {name: available[name] for name in REFERENCES if name in available}


def _task(stage: Stage, stamp: Stamp, cached: bool, folder: Path) -> outcome.Line:
    """A stage's line of `TASKS`."""
    timing = folder / TIMING
    times = read_json(timing, "a stage's times") if stage.method else {}
    return (
        stage.label,
        stage.capture,
        stage.method,
        stage.name,
        stamp.seconds,
        stamp.cpu_seconds,
        stamp.peak_memory_mb,
        cached,
        times.get("plan_seconds"),
        stamp.machine.get("host", ""),
        stamp.machine.get("gemm_gflops"),
        times.get("others_cores"),
        times.get("image_error"),
    )
