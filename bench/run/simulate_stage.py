"""The stage that simulates a scene: its description → a capture folder."""

from pathlib import Path
from typing import Any

from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import parse

CAPTURE = "capture"


def simulate(folder: Path, scene: dict[str, Any], base: str, frames: int) -> None:
    """Simulate a scene into the capture folder CAPTURE. base: the folder of the files that it
    names."""
    file = parse(SceneFile, scene, f"scene of {base}")
    simulate_capture(build(file, Path(base)), folder / CAPTURE, frames)
