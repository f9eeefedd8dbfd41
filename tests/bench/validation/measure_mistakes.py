"""Share of mistakes that `handbench inspect` meets with the right cure, over random scenes, and of
right data that it doubts. The mistakes are those of test_inspect, written into files.

    python -m tests.bench.validation.measure_mistakes [--scenes 20] [--right 200] -o FOLDER

Silent are also mistakes that change nothing which data could show, as a mirrored ball. A right
capture is rightly doubted where its target stands beyond what the method, with its defaults, looks
at.
"""

import argparse
import contextlib
import io
import json
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.studies.ablation import assorted_scenes
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from tests.bench.validation.test_inspect import ECHOES, SURFACES

TONES = {"sweep": [{"start_hz": 72e9, "stop_hz": 82e9, "count": 16}], "tones_hz": [81.8e9, 79.5e9]}
# in all, hours of simulation
SLOW = {"shadow_antennas", "shadow_diffraction", "multipath", "roughness", "clutter"}
RIGHT = 1000  # seed of the first capture without a mistake
FINE = "nothing looks wrong"
# their echoes are made for the plate, or their tones are
OF_THE_PLATE = {"one way", "tones", "twice", "gigahertz", "megahertz", "kilohertz", "nothing"}


def recorded(seed: int, folder: Path) -> tuple[RadarCapture, Any]:
    """The echoes of the scene of a seed, with its sensor's faults and noise, and its true
    surface."""
    assorted_scenes.TONES = TONES
    scene = assorted_scenes.assorted_scene(seed, folder)
    radar_scene = echo_scene(scene)
    there = tuple(e.id for e in EFFECTS if e.id not in SLOW and not e.missing(radar_scene))
    chosen = choose(radar_scene, there, tolerance_mm=0.0)
    return simulate_scene(radar_scene, chosen).capture, scene.target_mesh


def inspected(path: Path) -> str:
    """Everything that `handbench inspect` writes."""
    words = io.StringIO()
    with contextlib.redirect_stdout(words), contextlib.redirect_stderr(words):
        main(["inspect", str(path)])
    return words.getvalue()


def of_capture(folder: Path, capture: RadarCapture, surface: Any) -> str:
    """What it writes of a capture with these echoes."""
    folder.mkdir(exist_ok=True)
    save_capture(folder / "echoes.h5", capture)
    (folder / "capture.toml").write_text('version = 1\nname = "scene"\nkind = "other"\n')
    (folder / "truth.ply").unlink(missing_ok=True)
    if surface is not None:
        write_mesh(folder / "truth.ply", surface)
    return inspected(folder)


def run() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--right", type=int, default=200)
    parser.add_argument("-o", "--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, Counter[str]] = {}

    def count(name: str, cure: str, words: str) -> None:
        verdict = "cured" if cure in words else "silent" if FINE in words else "otherwise"
        found.setdefault(name, Counter())[verdict] += 1

    for seed in range(options.scenes):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "capture"
            capture, surface = recorded(seed, Path(scratch))
            for name, (change, cure) in ECHOES.items():
                if name not in OF_THE_PLATE:
                    count(name, cure, of_capture(folder, change(capture), surface))
            for name, (matrix, cure) in SURFACES.items():
                moved = mesh(np.asarray(surface.vertices) @ matrix, surface.triangles)
                count(f"mesh {name}", cure, of_capture(folder, capture, moved))
    for seed in range(RIGHT, RIGHT + options.right):
        with tempfile.TemporaryDirectory() as scratch:
            capture, surface = recorded(seed, Path(scratch))
            for known in (surface, None):  # without one, focus is left to go by
                words = of_capture(Path(scratch) / "capture", capture, known)
                doubted = "warning: " in words.replace("warning: nothing to score against", "")
                count("right captures", FINE, "doubted" if doubted else FINE)
    for name, of in found.items():
        print(f"{name}: {dict(of)}")
    (options.out / "counts.json").write_text(json.dumps(found, indent=2))


if __name__ == "__main__":
    run()
