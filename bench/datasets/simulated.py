"""Scene files, turned into capture folders."""

from __future__ import annotations

from pathlib import Path

from bench.datasets.native import ECHOES
from bench.scenes.capture import write_photos
from bench.scenes.echoes import echoes
from bench.scenes.scene import Scene
from radar.capture import save_capture
from radar.files import atomic_folder
from radar.progress import say


def simulate_capture(scene: Scene, folder: str | Path, frames: int = 1) -> None:
    """Write a capture folder: echoes, photographs, true surface and description, all or nothing."""
    with atomic_folder(folder) as temporary:
        say(f"{scene.file.name}: echoes")
        save_capture(temporary / ECHOES, echoes(scene, frames))
        say(f"{scene.file.name}: {len(scene.cameras)} photographs")
        write_photos(scene, temporary)
