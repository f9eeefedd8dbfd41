"""Each case simulated, imaged by each method and scored against the true surface."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from bench.evaluation.metrics import ErrorMap, error_map, pool, precision
from bench.run.repeat_stage import strongest_z_m
from bench.scenes.build import Scene, build
from bench.scenes.echoes import choices, echo_scene
from bench.studies.ablation.cases import Case, cases, scene_file
from groundtruth.mesh.depth import depth_on_grid
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.registry import method
from radar.simulation.selection import choose
from radar.simulation.simulate import simulate_scene
from radar.support.progress import track
from radar.warmup import compile_kernels

METHODS = ("2fsk", "3fsk", "broadband", "narrowband")
REPEATED = ("2fsk", "3fsk")  # methods whose precision is measured
CHANGED = "3fsk"  # the method whose depth map is compared with the reference's


@dataclass
class Row:
    """A case's figures over all poses. change_mm: mean |z − z of the case it is held against| of CHANGED; estimate_mm:
    what the effect's bound said; effect_s: seconds of the effect, of one left out those in the other case;
    simulate_s: seconds of the whole simulation. Seconds are per pose."""

    name: str
    values: dict[str, dict[str, float | int | None]] = field(default_factory=dict)  # method → metric → value
    change_mm: float = 0.0
    estimate_mm: float | None = None
    effect_s: float = 0.0
    simulate_s: float = 0.0


def ablate(poses: tuple[str, ...], frames: int) -> list[Row]:
    """All cases on all poses, `frames` repeats for the precision."""
    compile_kernels()
    found: dict[str, list[Shown]] = {}
    jobs = [(case, pose) for pose in poses for case in cases()]
    scenes = {pose: build(scene_file(pose, jobs[0][0])) for pose in poses}
    for case, pose in track(jobs, "ablation"):
        found.setdefault(case.name, []).append(show(pose, case, scenes[pose], frames))
    return [_row(case, found[case.name], found[case.against]) for case in cases()]


@dataclass(frozen=True)
class Shown:
    """One case on one pose."""

    maps: dict[str, ErrorMap]
    depth_m: np.ndarray  # of CHANGED
    repeats_z_m: dict[str, np.ndarray]
    estimate_mm: float | None
    seconds: dict[str, float]  # of each effect that was on
    simulate_s: float


def show(pose: str, case: Case, scene: Scene, frames: int) -> Shown:
    """Simulate, image and score one case; the mesh of `scene` is used again."""
    scene = replace(scene, file=scene_file(pose, case))
    radar_scene = echo_scene(scene)
    start = time.perf_counter()
    simulated = simulate_scene(radar_scene, choices(scene, radar_scene), frames)
    elapsed_s = time.perf_counter() - start
    depths = {name: image(name, simulated.capture, frames if name in REPEATED else 1) for name in METHODS}
    truth = {name: depth_on_grid(scene.target_mesh, d[0].x_m, d[0].y_m) for name, d in depths.items()}
    estimates = {row.effect: row.depth_mm for row in choose(radar_scene, "auto", 1.0)}
    return Shown(
        {name: error_map(d[0].x_m, d[0].y_m, d[0].z_m, truth[name]) for name, d in depths.items()},
        depths[CHANGED][0].z_m,
        {name: strongest_z_m(depths[name]) for name in REPEATED},
        estimates.get(case.effect),
        {row.effect: row.seconds for row in simulated.rows if row.seconds is not None},
        elapsed_s,
    )


def image(name: str, capture: RadarCapture, frames: int) -> list[DepthMap]:
    """The first frames by one method."""
    chosen = method(name)
    config = chosen.configure({}, "ablation")
    return [chosen.run(capture, config, frame).depth for frame in range(frames)]


def _row(case: Case, shown: list[Shown], reference: list[Shown]) -> Row:
    values = {m: pool([s.maps[m] for s in shown]) for m in METHODS}
    for m in REPEATED:
        values[m] |= precision([s.repeats_z_m[m] for s in shown])
    change_m = np.concatenate([np.abs(s.depth_m - r.depth_m).ravel() for s, r in zip(shown, reference, strict=True)])
    estimates = [s.estimate_mm for s in shown if s.estimate_mm is not None]
    effect_s = [{**r.seconds, **s.seconds}.get(case.effect, 0.0) for s, r in zip(shown, reference, strict=True)]
    return Row(
        case.name,
        values,
        1e3 * float(np.nanmean(change_m)),
        float(np.mean(estimates)) if estimates else None,
        float(np.mean(effect_s)),
        float(np.mean([s.simulate_s for s in shown])),
    )
