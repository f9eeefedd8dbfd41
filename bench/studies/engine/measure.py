"""The engine's benchmark: what imaging and simulation cost, measured in one run.

Seconds drift with the machine; ratio_to_exact, within one run, is what counts.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bench.studies.columns import Column, Record, Table
from bench.studies.engine.accuracy import bars, compilation, thread_differences
from bench.studies.engine.figure import draw
from bench.studies.engine.frame_rows import frame_rows, simulation_rows
from bench.studies.engine.growth import growth
from bench.studies.engine.scope import QUICK, Inputs, Scope
from bench.studies.engine.volume_rows import volume_rows
from bench.studies.study import Study

SECTIONS = {
    "compilation": compilation,
    "volume": volume_rows,
    "3-FSK frame": frame_rows,
    "simulation": simulation_rows,
    "growth": growth,
    "threads": thread_differences,
}
OF_ROWS = ("volume", "3-FSK frame", "simulation")


def _seconds(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.3g}" if isinstance(value, float) else f"{value:,}" for value in values)


def _met(value: bool) -> str:
    return "yes" if value else "**no**"


ROWS = {
    "section": Column("what the row is about", "section"),
    "method": Column("what was timed", "method"),
    "seconds": Column("median of the repeats for the whole work, without the plan", "seconds", _seconds),
    "seconds_low": Column("fastest of the repeats", "fastest", _seconds),
    "seconds_high": Column("slowest of the repeats", "slowest", _seconds),
    "extrapolated": Column("whether a part was measured for the whole"),
    "plan_seconds": Column("what the first call took longer", "plan s", "{:.2f}"),
    "ratio_to_exact": Column("the exact path's seconds over these", "exact / it", "{:,.3g}"),
    "frames_per_second": Column("frames in a second", "frames / s", "{:.1f}"),
    "relative_error": Column("L2, for the hand", "error", "{:.1e}"),
    "noise_error": Column("the same for white noise", "on noise", "{:.1e}"),
    "tolerance": Column("what was asked for"),
    "met": Column("whether both errors are within the tolerance", "met", _met),
    "depth_deviation_mm": Column("mean |Δz| of depths between voxels", "Δz mm", "{:.2g}"),
    "depth_deviation_voxel_mm": Column("the same of whole voxels", "whole voxels mm", "{:.2g}"),
    "mask_difference_px": Column("pixels that one mask alone holds", "mask px", "{:d}"),
    "gflops": Column("of the sums as they stand, 8 operations per voxel, channel and tone", "GFLOP/s"),
    "share_of_gemm": Column("of the rate of a float32 matrix product", "of ceiling", "{:.0f} %", 100),
    "peak_memory_mb": Column("by how much the first call raised the memory at most", "peak MB", "{:.0f}"),
    "fraction": Column("the part that was measured; the seconds are extrapolated from it", "of the whole", "{:.2g}"),
    "points": Column("points on target, or scatterers", "points", "{:,d}"),
}
GROWTH = {
    "what": Column("what grows", "growth"),
    "sizes": Column("its sizes", "sizes", _listed),
    "seconds": Column("of each size", "seconds", _listed),
    "plan_seconds": Column("of each size, once", "plan s", _listed),
    "exponent": Column("slope of log(seconds) over log(sizes)", "exponent", "{:.2f}"),
}
BARS = {
    "bar": Column("what has to hold", "bar"),
    "expected": Column("its limit", "expected"),
    "measured": Column("the figure", "measured"),
    "met": Column("whether it holds", "met", _met),
}


def study(work: Path, quick: bool, full: bool) -> Study:
    """Sections one after the other; full: the exact volume is measured whole."""
    scope = QUICK if quick else Scope()
    inputs = Inputs(replace(scope, exact_planes=None) if full else scope)
    title = "What imaging and simulation cost"
    return Study("engine", title, list(SECTIONS), lambda name: SECTIONS[name](inputs), tables, draw)


def tables(records: list[Record]) -> list[Table]:
    """Rows by section, growth, and the bars."""
    return [
        Table("rows", ROWS, [record for record in records if record["section"] in OF_ROWS], by="section"),
        Table("growth", GROWTH, [record for record in records if record["section"] == "growth"]),
        Table("bars", BARS, bars(records)),
    ]
