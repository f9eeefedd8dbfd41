"""One trial: the target simulated, calibrated as a user would, and compared with the truth."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.datasets.native import TARGET
from bench.datasets.simulated import simulate_capture
from bench.run.photogrammetry import calibrate_captures
from bench.scenes.echoes import choices, echo_scene
from bench.studies.registration.cases import Case, case, only
from bench.studies.registration.cloud import seen_cloud
from bench.studies.registration.score import Score, score
from calibration.registration.register import calibrate
from calibration.target.description import save_target
from calibration.transforms import Transform
from radar.data.capture import RadarCapture
from radar.simulation.scene import Ball, EchoScene
from radar.simulation.simulate import simulate_scene
from radar.support.errors import HandbenchError

CLUTTER_M = (0.010, 0.030)  # radius of the ball that stands beside the target, at least and at most
APART_M = 0.06  # from the target's balls, at least: nearer it would not be beside it


@dataclass(frozen=True)
class Trial:
    """A case and what came of it: its score, or why it was refused; seconds of the calibration alone."""

    case: Case
    seconds: float
    score: Score | None = None
    refused: str = ""


def photographed(number: int, work: Path) -> Trial:
    """Photographs and echoes simulated into a capture folder, and the calibration of that folder."""
    folder = work / f"placement-{number}"
    chosen = case(number, folder)
    capture = folder / "capture"
    if not capture.exists():
        simulate_capture(chosen.scene, capture)
        save_target(capture / TARGET, chosen.described)
    trial = _tried(chosen, lambda: calibrate_captures([capture], "draft", seed=0))
    shutil.rmtree(capture)  # 20 MB each
    return trial


def sampled(number: int, work: Path, fault: str) -> Trial:
    """Echoes simulated; in place of photographs a cloud of what the cameras would see of the spheres."""
    chosen = case(number, work / f"placement-{number}", fault, photographs=False)
    points_m, normals = seen_cloud(chosen)
    echoes = _echoes(chosen)
    return _tried(chosen, lambda: calibrate(points_m, normals, echoes, chosen.described))


def _tried(chosen: Case, work: Callable[[], Transform]) -> Trial:
    start = time.perf_counter()
    try:
        found = work()
    except HandbenchError as error:
        return Trial(chosen, time.perf_counter() - start, refused=str(error))
    return Trial(chosen, time.perf_counter() - start, score(found, chosen.scene.radar_from_photo))


def _echoes(chosen: Case) -> RadarCapture:
    scene = only(chosen.scene, chosen.heard)
    radar_scene = echo_scene(scene)
    if chosen.fault == "clutter":
        radar_scene = replace(radar_scene, balls=(*radar_scene.balls, _clutter(radar_scene, chosen.number)))
    return simulate_scene(radar_scene, choices(scene, radar_scene)).capture


def _clutter(scene: EchoScene, number: int) -> Ball:
    """A bare metal ball somewhere in the searched volume, beside the target."""
    rng = np.random.default_rng([number, 7])
    while True:
        centre_m = rng.uniform((-0.12, -0.12, 0.24), (0.12, 0.12, 0.40))
        if min(np.linalg.norm(centre_m - ball.centre_m) for ball in scene.balls) > APART_M:
            return Ball(centre_m, rng.uniform(*CLUTTER_M))
