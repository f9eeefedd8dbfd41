"""The stage that simulates a scene: its description → a capture folder."""

from pathlib import Path
from typing import Any

from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import parse

CAPTURE = "capture"


def simulate(folder: Path, scene: dict[str, Any], base: str, frames: int) -> None:
    """Simulate a scene into a capture folder, named CAPTURE, in a stage's folder.
    scene: the content of its file; base: folder where the files that it names are; frames: how
    many."""
    file = parse(SceneFile, scene, f"scene of {base}")
    simulate_capture(build(file, Path(base)), folder / CAPTURE, frames)
