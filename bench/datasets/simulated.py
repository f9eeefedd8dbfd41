"""Scene files, turned into capture folders."""

from __future__ import annotations

from pathlib import Path

from bench.datasets.native import ECHOES, EMPTY
from bench.scenes.build import Scene
from bench.scenes.capture_folder import write_photos
from bench.scenes.echoes import echoes
from radar.data.capture import save_capture
from radar.simulation.selection import Choice
from radar.support.files import atomic_folder
from radar.support.progress import say


def simulate_capture(scene: Scene, folder: str | Path, frames: int = 1) -> tuple[Choice, ...]:
    """Write a capture folder: echoes (and those of the empty room), photographs, true surface and description, all or
    nothing. Returns the effects' rows."""
    with atomic_folder(folder) as temporary:
        say(f"{scene.file.name}: echoes")
        simulated = echoes(scene, frames)
        save_capture(temporary / ECHOES, simulated.capture)
        if simulated.empty is not None:
            save_capture(temporary / EMPTY, simulated.empty)
        say(f"{scene.file.name}: {len(scene.cameras)} photographs")
        write_photos(scene, temporary, simulated.rows)
    return simulated.rows
