"""Imaging on a CUDA device: milliseconds between CUDA events, copies to and from the device
included.

The echoes are those of a bumpy surface at 0.28 m; grid, tones and array are the paper's. --device
cpu times the same on the processor, numpy in CuPy's place.

python -m tests.radar.imaging.measure_gpu [--device cuda|cpu|numpy] [--repeats 10] [-o DIR]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.evaluation.tables import Column
from handbench.bench.studies.study import Record, Study, Table, measured
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.api import image_volume, project_volume
from handbench.radar.imaging.certificate import imaging_error
from handbench.radar.imaging.device import array_module, current_device
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from tests.radar.simulated_points import bumpy, points_capture, surface_points

TOLERANCE = 1e-3
SHARE = Axis(
    start_m=-0.03, stop_m=0.03, step_m=0.001
)  # x and y of the exact sum's part of the volume
FIRST = "the first call: with the plan and, once per machine, the compilation"
WHOLE = "of the exact sum of the whole volume, from the part's"
ERROR = "relative L2 error at random voxels against the processor's exact sum"
COLUMNS = (
    Column("what", str, "what is imaged", heading="imaging"),
    Column("first_ms", float, FIRST, heading="first ms"),
    Column("ms", float, "median of the calls that follow", heading="ms"),
    Column("voxels", int, "of the volume, or of its part", heading="voxels", form="{:,}"),
    Column("whole_volume_ms", float, WHOLE, heading="whole volume ms", form="{:,.0f}"),
    Column("error", float, ERROR, heading="error", form="{:.1e}"),
)


def study(work: Path, device: str, repeats: int) -> Study:
    """Everything is one case, imaged on the device that is chosen."""
    configs = BroadbandConfig(), ThreeToneConfig(), SHARE
    return Study(
        "gpu",
        [f"{device}, {max(repeats, 1)} repeats"],
        lambda _: measure(*configs, max(repeats, 1)),
        lambda records: [Table("rows", COLUMNS, records)],
    )


def measure(
    volume: BroadbandConfig, frame: ThreeToneConfig, share: Axis, repeats: int
) -> list[Record]:
    """One row each for the exact sum of a part of the volume (x, y: `share`), the volume and its
    projection at TOLERANCE, and a 3-FSK frame, exact and at TOLERANCE."""
    grid, part = volume.grid(), volume.model_copy(update={"x": share, "y": share}).grid()
    wide = points_capture(surface_points(bumpy, 0.03, 5e-4), volume.tones_hz())
    tones = points_capture(surface_points(bumpy, 0.03, 5e-4), frame.ladder_hz)
    one = (wide.samples[0], wide.frequencies_hz, wide.aperture)
    whole = int(np.prod(grid.shape)) / int(np.prod(part.shape))
    exact, share_row = _timed("exact sum of a part", lambda: image_volume(*one, part, None), 1)
    fast, volume_row = _timed("volume", lambda: image_volume(*one, grid, TOLERANCE), repeats)
    _, peaks_row = _timed("projection", lambda: project_volume(*one, grid, TOLERANCE), repeats)
    frames = [
        _timed(
            name,
            partial(fsk_with_uncertainty, tones, frame.model_copy(update={"tolerance": tolerance})),
            repeats,
        )[1]
        for name, tolerance in (("3-FSK frame, exact", None), ("3-FSK frame", TOLERANCE))
    ]
    share_row |= {"voxels": exact.size, "whole_volume_ms": share_row["ms"] * whole}
    share_row["error"], volume_row["error"] = (
        imaging_error(exact, *one, part),
        imaging_error(fast, *one, grid),
    )
    volume_row["voxels"] = fast.size
    return [share_row, volume_row, peaks_row, *frames]


def _timed(name: str, work: Callable[[], Any], repeats: int) -> tuple[Any, Record]:
    """The value of work(), and its row: the first call's milliseconds and the median of `repeats`
    further ones."""
    result, first = _milliseconds(work)
    return result, {
        "what": name,
        "first_ms": first,
        "ms": statistics.median(_milliseconds(work)[1] for _ in range(repeats)),
    }


def _milliseconds(work: Callable[[], Any]) -> tuple[Any, float]:
    if current_device() != "cuda":
        start = time.perf_counter()
        return work(), 1e3 * (time.perf_counter() - start)
    cuda = array_module().cuda
    begin, end = cuda.Event(), cuda.Event()
    begin.record()
    result = work()
    end.record()
    end.synchronize()
    return result, float(cuda.get_elapsed_time(begin, end))


def main() -> None:
    """Time, write the files of a study, print the table."""
    prog, purpose = "python -m tests.radar.imaging.measure_gpu", (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "--device", choices=("cuda", "cpu", "numpy"), default="cuda", help="default cuda"
    )
    parser.add_argument(
        "--repeats", type=int, default=10, help="timings after the first (default 10)"
    )
    measured(parser, study, "gpu")


if __name__ == "__main__":
    main()
