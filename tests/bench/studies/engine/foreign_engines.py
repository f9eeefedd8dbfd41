"""Time at equal measured error: the engine beside direct, exact and range-compressed sums and
packages of others.

All paths image the same voxels from the same complex64 samples on one thread, in turns. `--site` is
the site-packages of an environment that holds the packages of others; those that are not installed
are left out.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from handbench.bench.evaluation.tables import declared_tables
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.cpu.exact import exact_sums
from handbench.support.errors import HandbenchError
from handbench.support.progress import track
from tests.bench.studies import script
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.engine.foreign_paths import ENGINE, Contender, contenders, engines, power
from tests.bench.studies.engine.scope import Inputs, Scope
from tests.bench.studies.study import BLUE, GREEN, GREY, ORANGE, VERMILION, Study, relative_error

SCHEMAS = declared_tables(__file__)
SMALL = Scope(
    lateral=Axis(start_m=-0.03, stop_m=0.03, step_m=0.001),
    depth=Axis(start_m=0.275, stop_m=0.295, step_m=0.001),
)
VOLUMES = {"61 × 61 × 21": (SMALL, contenders), "301 × 301 × 81": (Scope(), engines)}
CHECKED, ROUNDS = 4000, 5
LEVELS = (1e-2, 1e-3, 1e-4)
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "HANDBENCH_WORKERS")


def study(work: Path, site: Path | None) -> Study:
    """All paths on a part of the volume; the engine on the paper's too."""
    if site is not None:
        sys.path.append(str(site))  # of what both environments hold, ours is taken
    return Study(
        "foreign_engines", "Time at equal measured error", list(VOLUMES), measured, tables, draw
    )


def measured(volume: str) -> list[Record]:
    """A record for each path and setting. Raises HandbenchError where more than one thread may
    work."""
    more = [variable for variable in THREADS if os.environ.get(variable) != "1"]
    if more:
        raise HandbenchError(
            f"{', '.join(more)}: must be 1 before Python starts, so that no path has more threads"
        )
    scope, those = VOLUMES[volume]
    inputs = Inputs(scope)
    found = those(inputs)
    of_first = [clocked(path.once)[0] for path in track(found, f"{volume}: first calls")]
    accuracy = errors(inputs, found)
    rounds = np.array(
        [[of_volume(path) for path in found] for _ in track(range(ROUNDS), f"{volume}: rounds")]
    )  # [round, path, clock]
    return [
        {
            "volume": volume,
            "path": path.name,
            "setting": path.setting,
            "seconds": cpu_s,
            "wall_seconds": wall_s,
            "setup_seconds": max(first_s - cpu_s, 0.0) if path.name == ENGINE else None,
            "points_per_second": np.prod(inputs.grid.shape) / cpu_s,
            "fraction": path.fraction,
            **of,
        }
        for path, first_s, (cpu_s, wall_s), of in zip(
            found, of_first, np.median(rounds, axis=0), accuracy, strict=True
        )
    ]


def clocked(work: Callable[[], object]) -> np.ndarray:
    """Seconds [2] that a call takes of the processor, and by the clock."""
    start = time.process_time(), time.perf_counter()
    work()
    return np.subtract((time.process_time(), time.perf_counter()), start)


def of_volume(path: Contender) -> np.ndarray:
    """Seconds [2] of the whole volume, from those of the part and of what is done for no point."""
    fixed_s = clocked(path.fixed) if path.fixed else np.zeros(2)
    return fixed_s + (clocked(path.once) - fixed_s) / path.fraction


def errors(inputs: Inputs, found: list[Contender]) -> list[Record]:
    """Relative L2 errors of each path at random voxels, against the sum in float64."""
    voxels = np.random.default_rng(0).choice(
        int(np.prod(inputs.grid.shape)), CHECKED, replace=False
    )
    where = inputs.tones_hz, inputs.array, inputs.grid.points_at_m(voxels)
    exact = {source: exact_sums(samples, *where)[0] for source, samples in inputs.samples.items()}

    def error(path: Contender, source: str) -> float:
        values = path.values(voxels[: path.checked], inputs.samples[source])
        return relative_error(values, exact[source][: path.checked])

    return [
        {"relative_error": error(path, "hand"), "noise_error": error(path, "noise")}
        for path in track(found, "errors")
    ]


def seconds_at(level: float, error: np.ndarray, seconds: np.ndarray) -> float | None:
    """Seconds at a measured error: between the settings that no other beats in both, by logarithms;
    None where none comes down to it. Above the coarsest setting's error its seconds count: no knob
    makes it coarser."""
    order = np.argsort(error)
    front = [
        i
        for place, i in enumerate(order)
        if place == 0 or seconds[i] < seconds[order[:place]].min()
    ]
    if level < error[front[0]]:
        return None
    for finer, coarser in pairwise(front):
        if level < error[coarser]:
            share = np.log(level / error[finer]) / np.log(error[coarser] / error[finer])
            return float(seconds[finer] * (seconds[coarser] / seconds[finer]) ** share)
    return float(seconds[front[-1]])


def equal(records: list[Record]) -> list[Record]:
    """Each path at each of LEVELS, over the engine on the same voxels and, by points a second, on
    the paper's."""
    small, paper = VOLUMES
    fronts = {
        key: (
            of.relative_error.to_numpy(),
            of.seconds.to_numpy(),
            float((of.seconds * of.points_per_second).iloc[0]),
        )
        for key, of in pd.DataFrame(records).groupby(["volume", "path"], sort=False)
    }
    rows: list[Record] = []
    for level in LEVELS:
        speed = {}
        for key, (error, seconds, voxels) in fronts.items():
            at = seconds_at(level, error, seconds)
            speed[key] = None if at is None else voxels / at
        for (volume, name), points in speed.items():
            if volume == paper:
                continue
            row = {"level": f"error {power(level)}", "path": name, "reached": points is not None}
            if points is not None:
                row |= {"seconds": fronts[volume, name][2] / points, "points_per_second": points}
                over = {
                    "ratio_to_engine": speed[small, ENGINE],
                    "ratio_on_paper": speed.get((paper, ENGINE)),
                }
                row |= {column: engine / points for column, engine in over.items() if engine}
            rows.append(row)
    return rows


def tables(records: list[Record]) -> list[Table]:
    """Settings by volume, and the paths at equal error."""
    return [
        Table("rows", SCHEMAS["rows"].columns, records, by="volume"),
        Table("equal", SCHEMAS["equal"].columns, equal(records), by="level"),
    ]


def draw(frames: dict[str, pd.DataFrame]) -> Figure:
    """Measured error over points per CPU second, a line for each path; dashed: the engine on the
    paper's volume. Errors of the sum in double precision are drawn at the lower edge."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes, colours = figure.subplots(), {}
    palette = iter((BLUE, GREY, "black", VERMILION, GREEN, ORANGE))
    for (volume, name), rows in frames["rows"].groupby(["volume", "path"], sort=False):
        colour = colours.setdefault(name, next(palette, GREY))
        rows = rows.sort_values("relative_error")
        whole = volume != next(iter(VOLUMES))
        label = f"{name}, {volume} voxels" if name == ENGINE else name
        axes.plot(
            rows.points_per_second, rows.relative_error.clip(lower=3e-8), "s--" if whole else "o-", color=colour,
            markersize=4, label=label,
        )  # fmt: skip
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="points per CPU second, one thread",
        ylabel="measured relative error",
    )
    figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure


def main() -> None:
    """Measure, write the files of a study, print the tables."""
    prog = "python -m tests.bench.studies.engine.foreign_engines"
    parser = argparse.ArgumentParser(
        prog=prog, description="time at equal measured error, of our paths and of others'"
    )
    parser.add_argument(
        "--site", type=Path, help="site-packages of an environment with finufft and fastsar"
    )
    script.measured(parser, study, "foreign_engines")


if __name__ == "__main__":
    main()
