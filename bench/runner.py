"""The main job: every capture × method of a benchmark, from photographs and echoes to the table."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from bench import outcome, results, stages
from bench.cache import Cache, Stage, claimed
from bench.datasets.native import MESH, PHOTOS, TRUTH, load_capture_file
from bench.datasets.simulated import simulate_capture
from bench.outcome import Capture, Outcome
from bench.protocol import BenchFile, MethodEntry, Source
from bench.registry import method
from bench.results import REFERENCES, Repeat
from bench.scenes.file import SceneFile
from bench.scenes.scene import build, named_files
from calibration.rig import HAND_M
from calibration.transforms import Transform, identity, load_transform
from radar.config import load
from radar.depthmap import load_depthmap
from radar.device import chosen
from radar.effects.causes import Noise
from radar.errors import HandbenchError
from radar.files import content_hash, inside, read_json
from radar.kept import PACKAGES

# The code that each kind of stage runs: a change of it makes the stage anew.
MESHES = ("calibration/meshes.py", "calibration/transforms.py")
SIMULATION = (
    "radar", "bench/scenes", "bench/datasets", "calibration/target.py", *MESHES,
    "groundtruth/board.py", "groundtruth/cameras.py",
)
PHOTOGRAMMETRY = ("groundtruth", "bench/stages.py", *MESHES)
IMAGING = ("radar", "calibration/array/file.py", "bench/registry.py", "bench/stages.py")


def run(bench: BenchFile, base: Path, folder: Path, overwrite: bool = False) -> results.Result:
    """Run a benchmark whose paths start from `base` into a result folder; stages done before are taken from there."""
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    with claimed(folder) as work:
        _check_room(folder, config, overwrite)
        outcome.write(folder, Run(bench, base, Cache(work)).execute(), config)
    return results.load(folder)


def _check_room(folder: Path, config: str, overwrite: bool) -> None:
    """Refuse to mix with another benchmark's results."""
    before = folder / "config.toml"
    if before.exists() and before.read_text(encoding="utf-8") != config and not overwrite:
        raise HandbenchError(
            f"{folder}: holds the results of another configuration; choose another -o, or --overwrite to replace them"
        )


@dataclass
class Run:
    """A benchmark at work; paths start from `base`."""

    bench: BenchFile
    base: Path
    cache: Cache

    def execute(self) -> Outcome:
        """The list of steps."""
        repeats = self.bench.repeats if any(entry.precision for entry in self.bench.method) else 1
        captures = [self.capture(source, repeats) for source in self.bench.capture]
        found = Outcome(self.bench, captures, self.cache.tasks)
        registration = self.registration(found)
        for capture in captures:
            found.references[capture.name] = self.references(capture, registration, found)
        for entry in self.bench.method:
            for capture in captures:
                self.image(capture, entry, found)
        return found

    def capture(self, source: Source, frames: int) -> Capture:
        """A capture folder as it lies, or a scene simulated into one."""
        if source.path is not None:
            folder = inside(self.base, source.path, "capture.path")
            return Capture(folder, content_hash(folder), load_capture_file(folder))
        path = inside(self.base, source.scene or "", "capture.scene")
        scene = load(SceneFile, path, "a scene description")
        if self.bench.phase_noise_rad is not None:
            scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=self.bench.phase_noise_rad)})

        def make(folder: Path) -> None:
            simulate_capture(build(scene, path.parent), folder / "capture", frames)

        depends_on = [scene.model_dump(mode="json"), frames, *named_files(scene, path.parent)]
        stage = self.cache.stage("simulate", scene.name, "", depends_on, SIMULATION, make)
        return Capture(stage.folder / "capture", stage.key, load_capture_file(stage.folder / "capture"))

    def registration(self, found: Outcome) -> Transform | None:
        """radar_from_photo from the benchmark's target capture."""
        if not self.bench.calibration:
            return None
        targets = [self.capture(source, frames=1) for source in self.bench.calibration]
        quality, seed = self.bench.groundtruth.quality, self.bench.seed

        def make(folder: Path) -> None:
            made = stages.calibrate_captures([target.folder for target in targets], quality, seed, folder / "work")
            made.save(folder / "radar_from_photo.json")

        sources = (*PHOTOGRAMMETRY, "calibration", "radar")
        depends_on = [*(target.key for target in targets), quality, seed]
        stage = self.cache.stage("calibrate", targets[0].name, "", depends_on, sources, make)
        transform = load_transform(stage.folder / "radar_from_photo.json")
        found.inputs |= {f"calibration {target.name}": target.key for target in targets}
        found.facts["registration_residuals_mm"] = (1e3 * transform.residuals_m).tolist()
        true = targets[0].folder / "truth_radar_from_photo.json"
        if true.exists():
            found_m = transform.points(load_transform(true).inverse().points(HAND_M))
            found.facts["registration_error_at_hand_mm"] = 1e3 * float(np.linalg.norm(found_m - HAND_M))
        return transform

    def references(
        self, capture: Capture, registration: Transform | None, found: Outcome
    ) -> dict[str, tuple[Path, Transform]]:
        """Reference name → mesh file and the transform that carries it into the radar frame."""
        available: dict[str, tuple[Path, Transform]] = {}
        transform = stages.transform_of(capture.folder) or registration
        if transform is not None and transform.refined:
            found.facts.setdefault("refined_transforms", {})[capture.name] = transform.refined["reason"]
        if transform is not None and (capture.folder / MESH).exists():
            available["photogrammetry"] = capture.folder / MESH, transform
        elif transform is not None and (capture.folder / PHOTOS).is_dir():
            made = self.mesh(capture).folder
            available["photogrammetry"] = made / stages.MESH, transform
            found.views[capture.name] = made / stages.VIEW
        if (capture.folder / TRUTH).exists():
            available["truth"] = capture.folder / TRUTH, identity("radar")
        if not available:
            raise HandbenchError(
                f"{capture.folder}: nothing to score against; expected photographs or mesh.ply with a transform "
                "(radar_from_photo.json or the benchmark's [calibration]), or truth.ply"
            )
        return {name: available[name] for name in REFERENCES if name in available}

    def mesh(self, capture: Capture) -> Stage:
        """The capture's photographs as a mesh."""
        quality, seed = self.bench.groundtruth.quality, self.bench.seed

        def make(folder: Path) -> None:
            stages.make_mesh(capture.folder, quality, seed, folder)

        depends_on = [capture.key, quality, seed]
        return self.cache.stage("groundtruth", capture.name, "", depends_on, PHOTOGRAMMETRY, make)

    def image(self, capture: Capture, entry: MethodEntry, found: Outcome) -> None:
        """The capture's depth map by one method and, where asked for, its repeats."""
        config = stages.configuration(capture.folder, entry.id, entry.config).model_dump(mode="json")
        found.configs[capture.name, entry.id] = config

        def make_depth(folder: Path) -> None:
            stages.make_depth(capture.folder, entry.id, config, folder)

        def make_repeats(folder: Path) -> None:
            stages.make_repeats(capture.folder, entry.id, config, self.bench.repeats, folder)

        stage = self.imaging("reconstruct", capture, entry, [config], make_depth, found)
        found.maps[capture.name, entry.id] = load_depthmap(stage.folder / stages.DEPTH)
        if entry.precision:
            stage = self.imaging("repeat", capture, entry, [config, self.bench.repeats], make_repeats, found)
            z_m = stages.repeats_z_m(stage.folder)
            found.repeats += [Repeat(capture.name, entry.id, k, float(z)) for k, z in enumerate(z_m)]

    def imaging(
        self,
        name: str,
        capture: Capture,
        entry: MethodEntry,
        depends_on: list[Any],
        make: Callable[[Path], None],
        found: Outcome,
    ) -> Stage:
        """A stage that images, cached by the method's own source and by the device too; its times are kept."""
        code = Path(inspect.getsourcefile(method(entry.id).run) or "")
        sources = (*IMAGING, "bench/metrics.py")
        sources += (str(code.relative_to(PACKAGES)),) if code.is_relative_to(PACKAGES) else ()
        elsewhere = [] if code.is_relative_to(PACKAGES) else [code]
        depends_on = [capture.key, *depends_on, *elsewhere, chosen()]
        stage = self.cache.stage(name, capture.name, entry.id, depends_on, sources, make)
        times = read_json(stage.folder / stages.TIMING, "a stage's times")["seconds"]
        found.seconds.setdefault(entry.id, []).extend(times)
        return stage
