"""Run a whole benchmark: every capture × method, from photographs and echoes to the table.

Results do not depend on the executor, because the table is made from the files in the stages'
folders. A stage that fails is reported and recorded, and the run goes on without it.
"""

from collections.abc import Mapping
from concurrent.futures import Executor, Future
from itertools import product
from pathlib import Path
from queue import SimpleQueue
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import tomlkit

from handbench.bench import results
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import INSPECTION, TRUE_TRANSFORM
from handbench.bench.results import Failure
from handbench.bench.run import executors, planned_cost, write_result
from handbench.bench.run import jobs as plan
from handbench.bench.run.benchmark_file import BenchFile, Origin, Source, require_clear
from handbench.bench.run.calibrate_stage import REGISTRATION
from handbench.bench.run.executors import HASH
from handbench.bench.run.outcome import Line, Outcome, RunCapture, recorded_failure
from handbench.bench.run.photogrammetry import TARGET_QUALITY
from handbench.bench.run.reconstruct_stage import DEPTH, TIMING
from handbench.bench.run.repeat_stage import read_repeats
from handbench.bench.run.simulate_stage import CAPTURE
from handbench.calibration.registration.register import HAND_M
from handbench.calibration.transforms import Transform, load_transform
from handbench.support.cost import require_time
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from handbench.support.folder import locked
from handbench.support.progress import begin, end, predicted_work, say
from handbench.support.store import Stage, Stamp, cached


def run(
    bench: BenchFile,
    base: Path,
    folder: Path,
    overwrite: bool = False,
    scheduler: str | None = None,
    command: str | None = None,
) -> results.Result:
    """Run a benchmark into a result folder, and return the result read from it.
    base: folder to which the benchmark's paths are relative. Stages that `folder` already has are
    reused. overwrite: replace the results of another configuration. scheduler: address of a Dask
    scheduler whose workers see both folders under the same paths; None: run on this machine.
    command: the command line that repeats the run, for the report.
    Raises HandbenchError if the folder has the results of another benchmark, the predicted time is
    too long, or every capture fails."""
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    predicted = planned_cost.of_run(bench, base)
    ahead = planned_cost.one_after_another(predicted.values())
    if scheduler is None:  # of other machines neither cores nor memory are known
        require_time(
            ahead.core_s,
            f"{len(bench.capture)} captures × {len(bench.method)} methods",
            ahead.bytes_,
        )
    with (
        locked(folder) as work,
        executors.executor(scheduler, ahead.core_s, ahead.bytes_) as executor,
        predicted_work(ahead.core_s),
    ):
        _check_room(folder, config, overwrite)
        job = Run(bench, base.resolve(), work.resolve(), executor, predicted)
        job.open()
        job.inspect()
        stages = [*job.photographed(), *job.imaging()]
        job.collect(stages, job.perform(stages))
        job.find_references()
        job.score()
        job.found.facts |= {} if command is None else {"command": command}
        write_result.write(folder, job.found, config)
        del job  # frees its memory before the result is read
    return results.load(folder)


def _check_room(folder: Path, config: str, overwrite: bool) -> None:
    """Raise a HandbenchError if the folder has the results of another configuration and `overwrite`
    is false.
    config: the text of this run's config.toml."""
    before = folder / "config.toml"
    if before.exists() and before.read_text("utf-8", "replace") != config and not overwrite:
        raise HandbenchError(
            f"{folder}: has the results of another configuration; choose another folder, or "
            "replace them (--overwrite, in Python overwrite=True)"
        )


class StageOutcome(NamedTuple):
    """Outcome of one stage, which is a step of the run such as simulating, imaging or scoring one
    capture.
    key: hash of the stage's inputs and code. failure: the error, if it failed for a reason that the
    user can mend. task: the stage's line in the table of times; machine: facts of the machine that
    did it. Both are None if the stage has no folder."""

    key: str = ""
    failure: Failure | None = None
    task: Line | None = None
    machine: dict[str, Any] | None = None


class Run:
    """A benchmark in execution; its public methods are the steps, called by the function `run` in
    order.
    base: folder to which the benchmark's paths are relative; work: folder with one folder for each
    stage. found: everything that the steps have found so far; targets: captures of the calibration
    target; registration: transform from the photo frame to the radar frame; meshes: capture →
    folder with the mesh of its photographs; predicted: cost of the stages, for the progress bar."""

    def __init__(
        self,
        bench: BenchFile,
        base: Path,
        work: Path,
        executor: Executor,
        predicted: Mapping[planned_cost.Part, planned_cost.Work] = MappingProxyType({}),
    ) -> None:
        self.bench, self.base, self.work, self.executor = bench, base, work, executor
        self.predicted = predicted
        self.found = Outcome(bench, [], [])
        self.targets: list[RunCapture] = []
        self.registration: Transform | None = None
        self.meshes: dict[str, Path] = {}  # capture → folder of the mesh of its photographs

    def open(self) -> None:
        """Open the capture folders and simulate the scenes, for the benchmark and for its
        calibration.
        A capture of the benchmark that fails is recorded and left out. Raises HandbenchError if a
        capture of the calibration fails, or if two captures have the same name."""
        opening: list[tuple[Origin, Stage]] = []
        for source in self.bench.capture:
            with recorded_failure(self.found.failures, source.scene or source.path or "", "open"):
                frames = self.bench.frames_of(source)
                stage = plan.opening(
                    self.bench, self.base, source, frames, photos="accuracy" in source.measures
                )
                opening.append((source, stage))
        names = [require_clear(stage.capture, "capture") for _, stage in opening]
        if twice := [name for name in names if names.count(name) > 1]:
            raise HandbenchError(
                f"capture: two captures are named '{twice[0]}'; give each its own name"
            )
        for target in self.bench.calibration:
            opening.append((target, plan.opening(self.bench, self.base, target, frames=1)))
        for (origin, stage), done in zip(
            opening, self.perform([stage for _, stage in opening]), strict=True
        ):
            if not isinstance(origin, Source):
                _require_calibration(done)
            if done.failure is not None:
                continue
            folder = (
                Path(stage.arguments["folder"])
                if stage.name == HASH
                else stage.folder(self.work) / CAPTURE
            )
            about = open_capture(folder).about
            if isinstance(origin, Source):
                self.found.captures.append(RunCapture(folder, done.key, about, origin.measures))
                self.found.inputs[about.name] = done.key
            else:
                self.targets.append(RunCapture(folder, done.key, about))

    def inspect(self) -> None:
        """Check all captures for likely mistakes; print the warnings and record them for
        result.json."""
        stages = [plan.inspection(capture) for capture in self.found.captures]
        ended = zip(stages, self.perform(stages), strict=True)
        files = {
            stage.capture: stage.folder(self.work) / INSPECTION
            for stage, done in ended
            if done.failure is None
        }
        every = {name: read_json(file, "doubts")["doubts"] for name, file in files.items()}
        if warnings := {name: texts for name, texts in every.items() if texts}:
            self.found.facts["doubts"] = warnings

    def photographed(self) -> list[Stage]:
        """Reconstruct cameras and dense point clouds from all photographs that are needed.
        Returns the stages that remain to be done: the registration of camera and radar, if the
        benchmark calibrates, and for each capture the stage that makes its mesh. Raises
        HandbenchError if the photographs of a calibration capture cannot be reconstructed."""
        clouds, targets = (
            [
                plan.clouds(target, TARGET_QUALITY, self.bench.seed, self.work)
                for target in self.targets
            ],
            len(self.targets),
        )
        calibration = (
            [plan.calibration(self.targets, [dense for _, dense, _ in clouds], self.work)]
            if targets
            else []
        )
        for capture in self._accurate():
            with recorded_failure(self.found.failures, capture.name, "photographs"):
                if (meshed := plan.meshing(self.bench, capture, self.work)) is not None:
                    clouds.append(meshed)
        for round_ in range(2):
            ended = self.perform([stages[round_] for stages in clouds])
            _require_calibration(*ended[:targets])
            clouds = [
                stages for stages, done in zip(clouds, ended, strict=True) if done.failure is None
            ]
        return calibration + [mesh for _, _, mesh in clouds[targets:]]

    def imaging(self) -> list[Stage]:
        """Return the stages, not yet executed, that image every capture by every method."""
        stages: list[Stage] = []
        for capture, entry in product(self.found.captures, self.bench.method):
            with recorded_failure(self.found.failures, capture.name, "reconstruct", entry.id):
                stages += plan.imaging(self.bench, self.base, capture, entry)
        return stages

    def collect(self, stages: list[Stage], ended: list[StageOutcome]) -> None:
        """Read the results of finished stages from their folders into `found`, `registration` and
        `meshes`.
        stages: those that register the sensors, make meshes, or image; ended: their outcomes in the
        same order. Raises HandbenchError if the registration failed."""
        for stage, done in zip(stages, ended, strict=True):
            folder = stage.folder(self.work)
            if stage.name == "calibrate":
                _require_calibration(done)
                self._register(load_transform(folder / REGISTRATION))
            elif done.failure is None and stage.name == "mesh":
                self.meshes[stage.capture] = folder
            elif done.failure is None:
                self._collect_images(stage, folder)

    def _collect_images(self, stage: Stage, folder: Path) -> None:
        about = stage.capture, stage.method
        times = read_json(folder / TIMING, "a stage's times")["seconds"]
        self.found.seconds.setdefault(about, []).extend(times)
        self.found.configs[about] = stage.arguments["config"]
        if stage.name == "reconstruct":
            self.found.maps[about] = folder / DEPTH
        else:
            strongest_m, _ = read_repeats(folder)
            self.found.deviations[about] = folder
            self.found.repeats += [(*about, k, float(z)) for k, z in enumerate(strongest_m)]

    def _register(self, transform: Transform) -> None:
        """Store the transform radar_from_photo, and record its residuals, mm, for result.json.
        If the true transform is known, the error at the position of a hand, mm, is recorded too."""
        self.registration = transform
        self.found.inputs |= {f"calibration {target.name}": target.key for target in self.targets}
        self.found.facts["registration_residuals_mm"] = (1e3 * transform.residuals_m).tolist()
        true = self.targets[0].folder / TRUE_TRANSFORM
        if true.exists():
            found_m = transform.points(load_transform(true).inverse().points(HAND_M))
            self.found.facts["registration_error_at_hand_mm"] = 1e3 * float(
                np.linalg.norm(found_m - HAND_M)
            )

    def find_references(self) -> None:
        """Find for each capture the surfaces with which its depth maps are compared: mesh files and
        transforms.
        A capture without any is recorded as a failure."""
        without = {failure.capture for failure in self.found.failures if not failure.method}
        for name, capture in ((c.name, c) for c in self._accurate() if c.name not in without):
            with recorded_failure(self.found.failures, name, "references"):
                made = self.meshes.get(name)
                self.found.references[name] = plan.references(
                    capture, self.registration, made, self.found
                )

    def score(self) -> None:
        """Compare the depth maps of all captures with their references, and note the folders with
        the scores."""
        stages = []
        for capture in (c for c in self.found.captures if c.name in self.found.references):
            imaged = (
                (entry.id, self.found.maps.get((capture.name, entry.id)))
                for entry in self.bench.method
            )
            if maps := {method: file for method, file in imaged if file is not None}:
                stages.append(
                    plan.scoring(self.bench, capture, maps, self.found.references[capture.name])
                )
        for stage, done in zip(stages, self.perform(stages), strict=True):
            if done.failure is None:
                self.found.scores[stage.capture] = stage.folder(self.work)

    def _accurate(self) -> list[RunCapture]:
        return [capture for capture in self.found.captures if "accuracy" in capture.measures]

    def perform(self, stages: list[Stage]) -> list[StageOutcome]:
        """Execute stages that do not depend on each other, and return their outcomes in the same
        order.
        Failures, times and machines are recorded in `found`. An executor gets at most IN_FLIGHT
        (256) jobs at a time, so that no process holds the entire run in memory."""
        ended: dict[int, StageOutcome] = {}
        for executor, waiting in executors.assigned(self.executor, self.work, stages):
            running: dict[Future[Any], int] = {}
            finished: SimpleQueue[Future[Any]] = SimpleQueue()
            waiting.reverse()
            while waiting or running:
                if waiting and len(running) < executors.IN_FLIGHT and finished.empty():
                    number = waiting.pop()
                    self._begin(stages[number])
                    job = plan.content_key if stages[number].name == HASH else cached
                    future = executor.submit(job, self.work, stages[number])
                    running[future] = number
                    future.add_done_callback(finished.put)
                else:
                    future = finished.get()
                    number = running.pop(future)
                    ended[number] = self._outcome(stages[number], future)
        done = [ended[number] for number in range(len(stages))]
        self.found.failures += [each.failure for each in done if each.failure is not None]
        for each in done:
            if each.task is not None and each.machine is not None:
                self.found.tasks.append(each.task)
                self.found.machines.setdefault(each.machine.get("host", ""), each.machine)
        return done

    def _begin(self, stage: Stage) -> None:
        """Show a stage as begun on the progress bar."""
        part = stage.name, stage.capture, stage.method
        begin(stage.label, self.predicted[part].core_s if part in self.predicted else 0.0)

    def _outcome(self, stage: Stage, future: Future[Any]) -> StageOutcome:
        """Print how a stage ended, and return its outcome.
        future: the finished future of its job. Raises any error of the job that is not a
        HandbenchError."""
        try:
            made = future.result()
        except HandbenchError as error:
            failed = Failure(
                capture=stage.capture, method=stage.method, stage=stage.name, message=str(error)
            )
            end(stage.label)
            say(failed.line)
            return StageOutcome(failure=failed)
        if stage.name == HASH:
            end(stage.label)
            return StageOutcome(made)
        stamp, there = made
        end(stage.label, skipped=there)
        say(f"{stage.label}: " + ("cached" if there else f"{stamp.seconds:.1f} s"))
        return StageOutcome(
            stage.key,
            task=_task(stage, stamp, there, stage.folder(self.work)),
            machine=stamp.machine,
        )


def _require_calibration(*ended: StageOutcome) -> None:
    """Raise a HandbenchError if one of these stages of the calibration failed, because without the
    calibration no capture has a reference."""
    for done in ended:
        if done.failure is not None:
            raise HandbenchError(f"calibration: {done.failure.message}")


def _task(stage: Stage, stamp: Stamp, cached: bool, folder: Path) -> Line:
    """Return one stage's line of the table TASKS, which lists all stages: its names, times, memory
    and machine.
    cached: whether the stage had been finished by an earlier run; folder: the stage's own."""
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
