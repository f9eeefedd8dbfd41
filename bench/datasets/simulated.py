"""Scene files, turned into capture folders."""

from __future__ import annotations

from pathlib import Path

from bench.datasets.native import ECHOES, EMPTY
from bench.scenes.capture import write_photos
from bench.scenes.echoes import echoes
from bench.scenes.scene import Scene
from radar.capture import save_capture
from radar.effects.plan import Choice
from radar.files import atomic_folder
from radar.progress import say


def simulate_capture(scene: Scene, folder: str | Path, frames: int = 1) -> tuple[Choice, ...]:
    """Write a capture folder: echoes (and those of the empty room), photographs, true surface and description, all or
    nothing. Returns the effects' rows."""
    with atomic_folder(folder) as temporary:
        say(f"{scene.file.name}: echoes")
        shots = echoes(scene, frames)
        save_capture(temporary / ECHOES, shots.capture)
        if shots.empty is not None:
            save_capture(temporary / EMPTY, shots.empty)
        say(f"{scene.file.name}: {len(scene.cameras)} photographs")
        write_photos(scene, temporary, shots.rows)
    return shots.rows
