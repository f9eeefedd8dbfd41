"""Compute the figures of docs/measurements/hands.md that are in no result folder: python
docs/hand_causes.py

It measures how much the errors of the benchmark `hands` vary for each of three reasons. The hands
are all placed as the scene files say (only their shapes differ); the mean hand is placed as each
person places it (only the placements differ); and frames of three captures differ only in noise.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import METRICS, of_captures
from handbench.bench.pipeline.score import reference_of_file
from handbench.bench.run.benchmark_file import BenchFile, load_benchmark
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.calibration.transforms import identity
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.registry import method
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load

PLACEMENT = ("distance_m", "offset_m", "rotation_deg")


def figures(bench: BenchFile, scene: SceneFile, folder: Path, frames: int = 1) -> np.ndarray:
    """Simulate a scene, image it by every method of the benchmark, and return the mean absolute
    error, mm, against the true surface: [method, frame].
    folder: where the capture is written; frames: how many are simulated."""
    capture, found = folder / "capture", np.empty((len(bench.method), frames))
    simulate_capture(build(scene, folder), capture, frames)
    echoes, metric = open_capture(capture).echoes(), next(iter(METRICS))
    for number, entry in enumerate(bench.method):
        chosen = method(entry.id)
        for frame in range(frames):
            depth = chosen.run(echoes, chosen.configure(entry.config, entry.id), frame).depth
            grid = PixelGrid(depth.x_m, depth.y_m)
            truth = reference_of_file(capture / "truth.ply", identity("radar"), grid, exact=True)
            maps = [error_map(depth.x_m, depth.y_m, depth.z_m, truth.z_m)]
            found[number, frame] = of_captures(maps)[metric].iloc[0]
    return found


def main() -> None:
    """Print for each reason a line with the standard deviation of the error for each method, mm."""
    bench, base = load_benchmark("hands")
    noise = Noise(phase_noise_rad=bench.phase_noise_rad)
    causes: dict[str, list[np.ndarray]] = {"hands alone": [], "placements alone": [], "frames": []}
    for source in bench.capture:
        scene = load(SceneFile, base / str(source.scene), "a scene description")
        scene = scene.model_copy(update={"photos": None, "noise": noise})
        own = scene.of_person(*source.persons or ())
        still = {key: getattr(scene.target, key) for key in PLACEMENT}
        for cause, changed in (("hands alone", still), ("placements alone", {"person": 0})):
            case = own.model_copy(update={"target": own.target.model_copy(update=changed)})
            with tempfile.TemporaryDirectory() as folder:
                causes[cause].append(figures(bench, case, Path(folder))[:, 0])
        if own.target.person in (1, 2, 3):
            with tempfile.TemporaryDirectory() as folder:
                causes["frames"].append(
                    figures(bench, own, Path(folder), frames=5).std(axis=1, ddof=1)
                )
    print("standard deviation, mm", *(entry.id for entry in bench.method))
    for cause, rows in causes.items():
        table = np.array(rows)
        spread = (
            np.sqrt((table**2).mean(axis=0)) if cause == "frames" else table.std(axis=0, ddof=1)
        )
        print(cause, *(f"{value:.3f}" for value in spread))
        if cause != "frames":
            print(cause, "mean", *(f"{value:.2f}" for value in table.mean(axis=0)))


if __name__ == "__main__":
    main()
