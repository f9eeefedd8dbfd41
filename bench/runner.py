"""The main job: every capture × method of a benchmark, from photographs and echoes to the table."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from bench import results, stages
from bench.cache import Cache, Stage, locked
from bench.datasets.native import MESH, PHOTOS, TRUTH, CaptureFile, load_capture_file
from bench.datasets.simulated import simulate_capture
from bench.measure import machine, versions
from bench.metrics import ErrorMap, error_map
from bench.paper import TITLES
from bench.protocol import PROTOCOL, BenchFile, MethodEntry, Source
from bench.results import REFERENCES, About, CaptureFacts, MethodFacts, Repeat, Row, Surface
from bench.scenes.scene import Noise, SceneFile, build
from bench.table import accuracy_rows, metric_facts, precision_rows, time_rows
from calibration.transforms import Transform, identity, load_transform
from radar.config import load
from radar.depthmap import DepthMap, load_depthmap
from radar.errors import HandbenchError
from radar.files import content_hash, inside, read_json
from radar.grid import PixelGrid

OURS = ("result.json", "table.csv", "tasks.csv", "repeats.csv", "config.toml", "errors", "depth", "photos")
MESHES = ("calibration/meshes.py", "calibration/transforms.py")
SIMULATION = (
    "radar", "bench/scenes", "bench/datasets", "calibration/target.py", *MESHES,
    "groundtruth/board.py", "groundtruth/cameras.py",
)
PHOTOGRAMMETRY = ("groundtruth", "bench/stages.py", *MESHES)
IMAGING = ("radar", "bench/methods.py", "bench/registry.py", "bench/stages.py")


@dataclass
class Capture:
    """A capture of the run: its folder, the hash that stands for its content, its description."""

    folder: Path
    key: str
    about: CaptureFile


@dataclass
class Run:
    """A benchmark at work in its result folder."""

    bench: BenchFile
    base: Path
    folder: Path
    cache: Cache
    config: str
    rows: list[Row] = field(default_factory=list)
    repeats: list[Repeat] = field(default_factory=list)
    views: dict[str, Path] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def execute(self) -> None:
        """The list of steps."""
        captures = [self.capture(source) for source in self.bench.capture]
        self.check_names(captures)
        registration = self.registration()
        references = {c.about.name: self.references(c, registration) for c in captures}
        maps = self.depth_maps(captures)
        _drop_results(self.folder)
        errors = self.score(captures, references, maps)
        self.tabulate(captures, errors)
        self.write(captures, errors)

    def capture(self, source: Source) -> Capture:
        """A capture folder as it lies, or a scene simulated into one."""
        if source.path is not None:
            folder = inside(self.base, source.path, "capture.path")
            return Capture(folder, content_hash(folder), load_capture_file(folder))
        path = inside(self.base, source.scene or "", "capture.scene")
        scene = load(SceneFile, path, "a scene description")
        if self.bench.phase_noise_rad is not None:
            scene = scene.model_copy(update={"noise": Noise(phase_noise_rad=self.bench.phase_noise_rad)})
        frames = self.bench.repeats if any(entry.precision for entry in self.bench.method) else 1
        depends_on = [scene.model_dump(mode="json"), frames, *_named_files(scene, path.parent)]

        def make(folder: Path) -> None:
            simulate_capture(build(scene, path.parent), folder / "capture", frames)

        stage = self.cache.stage("simulate", scene.name, "", depends_on, SIMULATION, make)
        return Capture(stage.folder / "capture", stage.key, load_capture_file(stage.folder / "capture"))

    def check_names(self, captures: list[Capture]) -> None:
        """Names of captures name files, and must differ."""
        names = [c.about.name for c in captures]
        for name in names:
            results.depth_path(self.folder, name, "truth")
            if names.count(name) > 1:
                raise HandbenchError(f"capture: two captures are named '{name}'; give each its own name")

    def registration(self) -> tuple[Transform, str] | None:
        """radar_from_photo from the benchmark's target capture, with the hash that stands for it."""
        if self.bench.calibration is None:
            return None
        target = self.capture(self.bench.calibration)
        quality = self.bench.groundtruth.quality

        def make(folder: Path) -> None:
            transform = stages.calibrate_capture(target.folder, quality, self.bench.seed, folder / "work")
            transform.save(folder / "radar_from_photo.json")

        depends_on = [target.key, quality, self.bench.seed]
        sources = (*PHOTOGRAMMETRY, "calibration", "radar")
        stage = self.cache.stage("calibrate", target.about.name, "", depends_on, sources, make)
        transform = load_transform(stage.folder / "radar_from_photo.json")
        self.facts["registration_residuals_mm"] = (1e3 * transform.residuals_m).tolist()
        true = target.folder / "truth_radar_from_photo.json"
        if true.exists():
            here = np.array([[0.0, 0.0, 0.30]])
            there = load_transform(true).inverse().points(here)
            self.facts["registration_error_at_hand_mm"] = 1e3 * float(np.linalg.norm(transform.points(there) - here))
        return transform, stage.key

    def references(
        self, capture: Capture, registration: tuple[Transform, str] | None
    ) -> dict[str, tuple[Path, Transform]]:
        """Reference name → mesh file and the transform that carries it into the radar frame."""
        found: dict[str, tuple[Path, Transform]] = {}
        transform = stages.transform_of(capture.folder) or (registration[0] if registration else None)
        if transform is not None and (capture.folder / MESH).exists():
            found["photogrammetry"] = capture.folder / MESH, transform
        elif transform is not None and (capture.folder / PHOTOS).is_dir():
            made = self.mesh(capture).folder
            found["photogrammetry"] = made / stages.MESH, transform
            self.views[capture.about.name] = made / stages.VIEW
        if (capture.folder / TRUTH).exists():
            found["truth"] = capture.folder / TRUTH, identity("radar")
        if not found:
            raise HandbenchError(
                f"{capture.folder}: nothing to score against; expected photographs or mesh.ply with a transform "
                "(radar_from_photo.json or the benchmark's [calibration]), or truth.ply"
            )
        return {name: found[name] for name in REFERENCES if name in found}

    def mesh(self, capture: Capture) -> Stage:
        """The capture's photographs as a mesh."""
        quality, seed = self.bench.groundtruth.quality, self.bench.seed
        return self.cache.stage(
            "groundtruth", capture.about.name, "", [capture.key, quality, seed], PHOTOGRAMMETRY,
            lambda folder: stages.make_mesh(capture.folder, quality, seed, folder),
        )

    def depth_maps(self, captures: list[Capture]) -> dict[tuple[str, str], DepthMap]:
        """(capture, method) → depth map; precision repeats are taken on the way."""
        maps = {}
        for entry in self.bench.method:
            for capture in captures:
                config = stages.resolved_config(capture.folder, entry.id, entry.config)
                name = capture.about.name

                def make(folder: Path, capture: Capture = capture, entry: MethodEntry = entry) -> None:
                    stages.make_depth(capture.folder, entry.id, entry.config, folder)

                stage = self.cache.stage("reconstruct", name, entry.id, [capture.key, config], IMAGING, make)
                maps[name, entry.id] = load_depthmap(stage.folder / stages.DEPTH)
                self.keep_time(entry.id, stage)
                if entry.precision:
                    self.take_repeats(capture, entry, config)
        return maps

    def take_repeats(self, capture: Capture, entry: MethodEntry, config: dict[str, Any]) -> None:
        """The strongest scatterer's depth in every frame of the capture."""
        frames, name = self.bench.repeats, capture.about.name
        stage = self.cache.stage(
            "repeat", name, entry.id, [capture.key, config, frames], (*IMAGING, "bench/metrics.py"),
            lambda folder: stages.make_repeats(capture.folder, entry.id, entry.config, frames, folder),
        )
        self.keep_time(entry.id, stage)
        z_m = stages.repeats_z_m(stage.folder)
        self.repeats += [Repeat(name, entry.id, k, float(z)) for k, z in enumerate(z_m)]

    def keep_time(self, method_id: str, stage: Stage) -> None:
        """Remember the imaging times of a stage."""
        seconds = read_json(stage.folder / stages.TIMING, "a stage's times")["seconds"]
        self.facts.setdefault("seconds", {}).setdefault(method_id, []).extend(seconds)

    def score(
        self,
        captures: list[Capture],
        references: dict[str, dict[str, tuple[Path, Transform]]],
        maps: dict[tuple[str, str], DepthMap],
    ) -> dict[tuple[str, str, str], ErrorMap]:
        """(capture, method, reference) → errors; depth maps and references are written on the way."""
        errors = {}
        for name, files in ((c.about.name, references[c.about.name]) for c in captures):
            for reference, (file, transform) in files.items():
                for entry in self.bench.method:
                    depth = maps[name, entry.id]
                    z_m = stages.reference_depth(file, transform, PixelGrid(depth.x_m, depth.y_m))
                    errors[name, entry.id, reference] = error_map(depth.x_m, depth.y_m, depth.z_m, z_m)
                    depth.save(results.depth_path(self.folder, name, entry.id))
                results.write_surface(self.folder, name, reference, Surface(depth.x_m, depth.y_m, z_m))
        return errors

    def tabulate(self, captures: list[Capture], errors: dict[tuple[str, str, str], ErrorMap]) -> None:
        """The table's rows, one block per reference."""
        for reference in REFERENCES:
            for entry in self.bench.method:
                maps = [e for (_, m, r), e in errors.items() if (m, r) == (entry.id, reference)]
                if not maps:
                    continue
                self.rows += accuracy_rows(entry.id, reference, maps, self.bench.seed)
                if entry.precision:
                    self.rows += precision_rows(entry.id, reference, self.strongest(captures, entry.id))
                self.rows += time_rows(entry.id, reference, self.facts["seconds"][entry.id], self.bench.seed)

    def strongest(self, captures: list[Capture], method_id: str) -> list[np.ndarray]:
        """Each capture's depths of the strongest scatterer [repeats]."""
        return [
            np.array([r.z_m for r in self.repeats if (r.capture, r.method) == (c.about.name, method_id)])
            for c in captures
        ]

    def write(self, captures: list[Capture], errors: dict[tuple[str, str, str], ErrorMap]) -> None:
        """The result folder; result.json comes last and makes it complete."""
        for (name, method_id, reference), error in errors.items():
            results.write_errors(self.folder, name, method_id, reference, error)
        for name, view in self.views.items():
            results.write_photo(self.folder, name, view)
        results.write_config(self.folder, self.config)
        results.write_table(self.folder, self.rows)
        results.write_tasks(self.folder, self.cache.tasks)
        results.write_repeats(self.folder, self.repeats)
        results.write_about(self.folder, self.about(captures, errors))

    def about(self, captures: list[Capture], errors: dict[tuple[str, str, str], ErrorMap]) -> About:
        """What result.json says."""
        facts = {key: value for key, value in self.facts.items() if key != "seconds"}
        return About(
            name=self.bench.name,
            protocol={**PROTOCOL, "repeats": self.bench.repeats, "seed": self.bench.seed},
            metrics=metric_facts(),
            inputs={c.about.name: c.key for c in captures},
            versions=versions(),
            machine=machine(),
            captures=tuple(
                CaptureFacts(
                    name=c.about.name,
                    pose=c.about.pose,
                    distance_m=c.about.distance_m,
                    references=tuple(r for r in REFERENCES if (c.about.name, self.bench.method[0].id, r) in errors),
                )
                for c in captures
            ),
            methods=tuple(
                MethodFacts(name=e.id, title=TITLES.get(e.id, e.id), config=e.config) for e in self.bench.method
            ),
            facts={**facts, "phase_noise_rad": self.bench.phase_noise_rad},
        )


def run(bench: BenchFile, base: Path, folder: Path, overwrite: bool = False) -> results.Result:
    """Run a benchmark whose paths start from `base` into a result folder; stages done before are taken from there."""
    config = tomlkit.dumps(bench.model_dump(mode="json", exclude_none=True))
    with locked(folder / "work"):
        _check_room(folder, config, overwrite)
        Run(bench, base, folder, Cache(folder / "work"), config).execute()
    return results.load(folder)


def _check_room(folder: Path, config: str, overwrite: bool) -> None:
    """Refuse to mix with another benchmark's results or a stranger's files."""
    strange = [p.name for p in folder.iterdir() if p.name not in (*OURS, "work", "report") and not _left_over(p)]
    if strange:
        raise HandbenchError(f"{folder}: holds {strange[0]}, which no run wrote; choose an empty or new folder for -o")
    before = folder / "config.toml"
    if before.exists() and before.read_text(encoding="utf-8") != config and not overwrite:
        raise HandbenchError(
            f"{folder}: holds the results of another configuration; choose another -o, or --overwrite to replace them"
        )


def _drop_results(folder: Path) -> None:
    """Remove the results that are about to be written anew, result.json (which says that they are complete) first."""
    for path in [folder / name for name in OURS] + [p for p in folder.iterdir() if _left_over(p)]:
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def _left_over(path: Path) -> bool:
    """Whether this is a half-written result of a run that was killed."""
    return any(path.name.startswith(f".{Path(name).stem}-") for name in OURS)


def _named_files(scene: SceneFile, folder: Path) -> list[Path]:
    """Files that a scene names: their content belongs to the scene."""
    names = [getattr(scene.target, key, None) for key in ("file", "path")]
    return [inside(folder, name, "target") for name in names if name]
