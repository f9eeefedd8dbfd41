"""The stage that takes a submitted depth map, checked, in the place of one that a method here images."""

from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.pipeline.image import configuration
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.reconstruct_stage import DEPTH, TIMING, write_treated
from handbench.bench.submissions.submission import depth_map, load_submission
from handbench.radar.data.grid import PixelGrid, VoxelGrid
from handbench.radar.methods.fsk_config import PixelsConfig
from handbench.radar.methods.registry import method
from handbench.support.files import write_json


def take(folder: Path, submission: str, capture: str, x_m: np.ndarray, y_m: np.ndarray, config: Any) -> None:
    """A capture's depth map → DEPTH, for equal treatment too, averaged or not; its seconds → TIMING. Pixels that the
    method has averaged itself stay so. HandbenchError as `depth_map`."""
    about, rows = load_submission(submission)
    grid = PixelGrid(x_m, y_m)
    depth = depth_map(Path(submission), rows[capture], about.method, grid)
    write_treated(folder, lambda settings: depth, PixelsConfig(), depth)
    depth.save(folder / DEPTH)
    write_json(folder / TIMING, {"seconds": [rows[capture].seconds]})


def grid_of(bench: BenchFile, capture: Path | None) -> PixelGrid:
    """The pixels that a capture's submitted maps have: those of the benchmark's first own method, or else the paper's.
    capture: its folder, None where it is simulated."""
    entry = next((entry for entry in bench.method if entry.submission is None), None)
    if entry is None:
        return PixelsConfig().grid()
    chosen = method(entry.id).configure(entry.config, f"method '{entry.id}'")
    chosen = configuration(capture, entry.id, entry.config) if capture else chosen
    grid = chosen.grid() if hasattr(chosen, "grid") else PixelsConfig().grid()
    return grid.pixels if isinstance(grid, VoxelGrid) else grid
