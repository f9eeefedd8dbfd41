"""The stage that simulates a scene: it turns a scene description into a capture folder."""

from pathlib import Path
from typing import Any

from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import parse
from handbench.support.store import stage

CAPTURE = "capture"


@stage(
    "simulate",
    "bench/stages/simulate.py",
    "bench/datasets",
    "bench/scenes",
    "calibration",
    "groundtruth/board.py",
    "groundtruth/cameras.py",
    "groundtruth/mesh",
    "radar/data",
    "radar/imaging",
    "radar/simulation",
)
def simulate(folder: Path, scene: dict[str, Any], base: str, frames: int) -> None:
    """Simulate a scene, and write the capture into the folder CAPTURE inside a stage's folder.
    scene: content of the scene file; base: folder of the files that the scene names; frames: how
    many frames are simulated."""
    file = parse(SceneFile, scene, f"scene of {base}")
    simulate_capture(build(file, Path(base)), folder / CAPTURE, frames)
