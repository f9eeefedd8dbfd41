"""The engine's benchmark: what imaging and simulation cost, measured in one run.

Seconds drift with the machine; ratio_to_exact, within one run, is what counts.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from handbench.bench.evaluation.tables import declared_tables, each
from tests.bench.studies import script
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.engine.checks import bars, compilation, growth
from tests.bench.studies.engine.roofline import roofline_rows
from tests.bench.studies.engine.scope import QUICK, Inputs, Scope
from tests.bench.studies.engine.volume_rows import frame_rows, simulation_rows, volume_rows
from tests.bench.studies.study import BLUE, GREEN, GREY, VERMILION, Study

SECTIONS = {
    "compilation": compilation,
    "volume": volume_rows,
    "3-FSK frame": frame_rows,
    "simulation": simulation_rows,
    "growth": growth,
    "roofline": roofline_rows,
}
SCHEMAS = declared_tables(__file__)
OF_ROWS = ("volume", "3-FSK frame", "simulation")


def study(work: Path, quick: bool, full: bool) -> Study:
    """Sections one after the other; full: the exact volume is measured whole."""
    scope = QUICK if quick else Scope()
    inputs = Inputs(replace(scope, exact_planes=None) if full else scope)
    title = "What imaging and simulation cost"
    return Study("engine", title, list(SECTIONS), lambda name: SECTIONS[name](inputs), tables, draw)


def tables(records: list[Record]) -> list[Table]:
    """Rows by section, growth, the roofline, and the bars."""
    sections = OF_ROWS, ("growth",), ("roofline",)
    of_rows, of_growth, of_roof = (
        [r for r in records if r["section"] in names] for names in sections
    )
    return [
        Table("rows", SCHEMAS["rows"].columns, of_rows, by="section"),
        Table("growth", SCHEMAS["growth"].columns, of_growth),
        Table("roofline", SCHEMAS["roofline"].columns, of_roof),
        Table("bars", SCHEMAS["bars"].columns, bars(records)),
    ]


DOUBLE = 1e-9  # errors that single precision cannot have


def draw(frames: dict[str, pd.DataFrame]) -> Figure | None:
    """Left: the errors of the volume; middle: growth with the voxels; right: the roofline; None
    where any was not measured."""
    roofline, rows, growth = (
        frames["roofline"],
        frames["rows"].query("section == 'volume'"),
        frames["growth"],
    )
    if rows.empty or growth.empty or roofline.empty:
        return None
    figure = Figure(figsize=(13.5, 4.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(3, 2, 2))
    _errors(left, rows)
    _growth(middle, growth[growth.what.str.startswith("voxels")].to_dict("records"))
    _roofline(right, roofline)
    return figure


def _errors(axes: Axes, rows: pd.DataFrame) -> None:
    """Relative error over seconds per volume; open markers are extrapolated."""
    for what, colour, marker in (("volume", BLUE, "o"), ("projection", GREEN, "s")):
        some = rows[rows.tolerance.notna() & rows.method.str.contains(what)]
        axes.plot(some.seconds, some.relative_error, marker + "-", color=colour, markersize=5)
        if what == "volume":
            axes.plot(some.seconds, some.noise_error, marker + ":", color=colour, markersize=3)
            for row in each(some):
                text = f"  {row.tolerance:.0e}".replace("e-0", "e-")
                axes.annotate(
                    text, (row.seconds, row.noise_error), va="bottom", color=colour, fontsize=8
                )
    for i, row in enumerate(each(rows[rows.extrapolated | (rows.method == "exact")])):
        error, name = row.relative_error, row.method.replace(", ", ",\n")
        text = (
            f"{name}\n{row.seconds:,.0f} s"
            if row.seconds >= 100
            else f"{name}\n{row.seconds:.3g} s"
        )
        if not error > DOUBLE:  # in double precision: exact on this scale
            axes.axvline(row.seconds, color=GREY, linestyle="--", linewidth=0.8)
            axes.annotate(
                text, (row.seconds, 0.97 - 0.3 * i), (-3, 0), ("data", "axes fraction"), "offset "
                                                                                         "points",
                ha="right", va="top", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
            )  # fmt: skip
            continue
        axes.plot(
            row.seconds,
            error,
            "D",
            color=VERMILION,
            fillstyle="none" if row.extrapolated else "full",
        )
        at = (row.seconds, error)
        axes.annotate(text, at, xytext=(0, 7), textcoords="offset points", ha="center", va="bottom")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="seconds per volume",
        ylabel="relative error of the volume",
    )
    axes.set(ylim=(2e-8, 5e-2))


def _growth(axes: Axes, series: list[Record]) -> None:
    """Seconds over voxels, with proportional growth for comparison."""
    for entry, colour, marker in zip(series, (BLUE, VERMILION), ("o", "s"), strict=False):
        sizes, seconds = np.array(entry["sizes"], float), np.array(entry["seconds"])
        axes.plot(sizes, seconds, marker + "-", color=colour, markersize=5)
        name = entry["what"].removeprefix("voxels, ")
        text = f"{name}: exponent {entry['exponent']:.2f}"
        axes.annotate(
            text,
            (0.05, 0.93 - 0.07 * (colour == VERMILION)),
            xycoords="axes fraction",
            color=colour,
        )
    sizes, seconds = np.array(series[0]["sizes"], float), series[0]["seconds"]
    axes.plot(sizes, seconds[0] * sizes / sizes[0], color=GREY, linestyle=":", linewidth=0.8)
    axes.set(xscale="log", yscale="log", xlabel="voxels", ylabel="seconds at a tolerance of 1e-3")


def _roofline(axes: Axes, rows: pd.DataFrame) -> None:
    """Each part's rate on one core over its operations a byte, under the roof of a copy and a
    matrix product."""
    gemm, copy = rows.gemm_rate.iloc[0], rows.copy_rate.iloc[0]
    intensity = np.geomspace(1, 2 * max(rows.intensity.max(), gemm / copy), 50)
    axes.plot(intensity, np.minimum(gemm, copy * intensity), color=GREY, linewidth=1.0)
    axes.plot(
        intensity,
        0.6 * np.minimum(gemm, copy * intensity),
        color=GREY,
        linestyle=":",
        linewidth=0.8,
    )
    for row, colour in zip(each(rows), (BLUE, GREEN, VERMILION), strict=False):
        axes.plot(
            row.intensity,
            row.rate,
            "o",
            color=colour,
            label=f"{row.part.split(',')[0]}: {100 * row.share:.0f} %",
        )
    axes.legend(loc="lower right", frameon=False, fontsize=8)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="operations a byte",
        ylabel="GFLOP/s of one core (dotted: 60 %)",
    )


def main() -> None:
    """Measure, write the files of a study, print the tables."""
    prog = "python -m tests.bench.studies.engine.measure_engine"
    purpose = "what imaging and simulation cost in time, error and memory, and how that grows"
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "--quick", action="store_true", help="a small volume, in two minutes: does it all run?"
    )
    whole = "measure the exact volume whole instead of extrapolating"
    parser.add_argument("--full", action="store_true", help=whole)
    script.measured(parser, study, "engine")


if __name__ == "__main__":
    main()
