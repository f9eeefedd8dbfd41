"""Sensitivity: what would have to be true for the paper's table, over all that its set-up leaves
open. The two parts are each factor by itself, and a joint design.

python -m tests.bench.studies.sensitivity.measure_sensitivity BENCH [--factors FILE.toml] [--parts
one|joint] [-o DIR]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from math import ceil
from pathlib import Path

import pandas as pd

from handbench.bench.evaluation.metrics import METRICS, TITLES
from handbench.bench.evaluation.tables import Column, declared_tables
from handbench.bench.run.benchmark_file import load_benchmark
from tests.bench.studies.columns import Record, Table
from tests.bench.studies.script import measured
from tests.bench.studies.sensitivity.measurement import Measurement
from tests.bench.studies.sensitivity.nearness import KEYS, PAPER, answer, factor_records
from tests.bench.studies.sensitivity.sensitivity_cases import joint, one_at_a_time, shown
from tests.bench.studies.sensitivity.sensitivity_factors import (
    DEFAULT,
    Factors,
    FactorsFile,
    load_factors,
)
from tests.bench.studies.sensitivity.sensitivity_figure import draw_map, draw_tornadoes
from tests.bench.studies.study import Study

SCHEMAS = declared_tables(__file__)
SHOWN = 10  # settings of the joint design on its page
SETTING = {column.name: column for column in SCHEMAS["setting"].columns}
TOLD = [SETTING[name] for name in ("number", "name", "factor", "values", "placement")]
NAME = SETTING["name"]
PRINTED: Record = {"name": "the paper", **{name: f"{value:g}" for name, value in PAPER.items()}}
VERDICT = [SETTING[name] for name in ("distance", "agree", "turned")]
ONE = """\
Every figure of the paper's Table I, against the true surface, with one factor changed at a time and all else as the
benchmark has it. Accuracy: mean ± standard deviation over {frames} draws of all that is random (noise, phases, errors
of antennas and reference), of figures that are means over the poses. Precision: with the standard deviation that its
{repeats} repeats leave. The first rows are the paper and the benchmark itself; the third has the method's own tones and
tolerance, without the study's economies.{left_out}"""
JOINT = """\
{settings} settings of {factors} factors: a Latin hypercube over what is received and processed, on top of
{placements} simulated placements, which are a Latin hypercube of their own. One draw of all that is random each; the
seed is {seed}. Reference: the true surface."""


def studies(work: Path, bench: str, factors: Path, parts: str | None) -> list[Study]:
    """Both parts, or the one that is named; they share echoes and images."""
    chosen, base = load_benchmark(bench)
    measurement = Measurement(chosen, base.resolve(), load_factors(factors), work)
    return [PARTS[part](measurement) for part in ([parts] if parts else PARTS)]


def one_part(measurement: Measurement) -> Study:
    """Each factor by itself."""
    file = measurement.factors_file
    others = [
        entry.id for entry in measurement.bench.method if entry not in measurement.entries.values()
    ]
    left_out = f" Not of the paper's table, and left out: {', '.join(others)}." if others else ""
    text = ONE.format(frames=file.frames, repeats=measurement.bench.repeats, left_out=left_out)
    return Study(
        "one_at_a_time",
        "Sensitivity: one factor at a time",
        one_at_a_time(file),
        measurement,
        lambda records: [
            Table("rows", [*TOLD, *_figures(), *_spreads(), *VERDICT], records, shown=False),
            Table("table", [NAME, *_texts(), *VERDICT[:2]], [PRINTED, *map(_worded, records)]),
            _ranges(file),
        ],
        draw_tornadoes,
        label=lambda case: case.name,
        seed=measurement.bench.seed,
        text=text,
    )


def joint_part(measurement: Measurement) -> Study:
    """The joint design."""
    file = measurement.factors_file
    cases = joint(file)
    varied = {name: file.factor.listed()[name] for name in cases[0].values}

    def tables(records: list[Record]) -> list[Table]:
        settings = pd.DataFrame([r for r in records if r["distance"] == r["distance"]])
        settings = settings.sort_values("distance", ignore_index=True)
        nearest = settings.head(ceil(len(settings) * file.near_percent / 100))
        factors = factor_records(settings, varied, nearest)
        turned = settings.assign(distance=settings.turned.astype(float))
        below = turned[turned.distance > 0]
        order = factor_records(turned, varied, below) if len(below) else []
        words = answer(settings, len(cases), factors, order, file)
        given = [
            Column(n, str, Factors.model_fields[n].description or "", heading=n) for n in varied
        ]
        near = [_worded(record) for record in _records(settings.head(SHOWN))]
        every = [*TOLD, *(replace(column, heading="") for column in given), *_figures(), *VERDICT]
        known = SCHEMAS["factors"].columns
        return [
            Table("settings", every, _records(settings), shown=False),
            Table("nearest", [NAME, *_texts(), *VERDICT[:2]], [PRINTED, *near]),
            Table("values", [NAME, *given], near, note=words),
            Table("factors", known, factors),
            Table("order", known, order, shown=False),
        ]

    return Study(
        "joint",
        "Sensitivity: all factors jointly",
        cases,
        measurement,
        tables,
        lambda frames: draw_map(frames, varied),
        label=lambda case: case.name,
        seed=file.seed,
        text=JOINT.format(
            settings=file.settings, factors=len(varied), placements=file.placements, seed=file.seed
        ),
    )


PARTS: dict[str, Callable[[Measurement], Study]] = {"one": one_part, "joint": joint_part}


def _figures() -> list[Column]:
    """The ten figures as numbers, for the files."""
    return [
        Column(f"{m}_{key}", float, METRICS[key].definition, "mm")
        for key in KEYS
        for m in METRICS[key].paper
    ]


def _texts() -> list[Column]:
    """The same for the page, in words."""
    names = {
        f"{m}_{key}": f"{TITLES[m]} {METRICS[key].title.split()[0]}"
        for key in KEYS
        for m in METRICS[key].paper
    }
    return [Column(c.name, str, f"{c.meaning}, mm", heading=names[c.name]) for c in _figures()]


def _spreads() -> list[Column]:
    """Of the draws, for the files."""
    words = {"sd": "standard deviation", "low": "lowest", "high": "highest"}
    ends = [
        (c.name, end)
        for c in _figures()
        for end in words
        if end == "sd" or not c.name.endswith(KEYS[-1])
    ]
    return [
        Column(f"{name}_{end}", float, f"{words[end]} over the draws", "mm") for name, end in ends
    ]


def _worded(record: Record) -> Record:
    """A setting as the page has it: figures as "6.05 ± 0.31", factors with their units."""
    cells = {}
    for name in PAPER:
        value, sd = record.get(name), record.get(f"{name}_sd")
        cells[name] = (
            "" if value is None else f"{value:.2f}" + (f" ± {sd:.2f}" if sd is not None else "")
        )
    return {
        **record,
        **cells,
        **{n: shown(n, v) for n, v in record.items() if n in Factors.model_fields},
    }


def _records(settings: pd.DataFrame) -> list[Record]:
    return [
        {str(name): value for name, value in line.items()} for line in settings.to_dict("records")
    ]


def _ranges(file: FactorsFile) -> Table:
    """The factors with their values and meanings."""
    known = Factors.model_fields
    records: list[Record] = [
        {
            "factor": n,
            "values": ", ".join(shown(n, v) for v in values),
            "meaning": known[n].description,
        }
        for n, values in file.factor.listed().items()
    ]
    return Table("factors", SCHEMAS["range"].columns, records)


def main() -> None:
    """Measure, write the files of each part, print the tables and the answer in words."""
    prog = "python -m tests.bench.studies.sensitivity.measure_sensitivity"
    purpose = "what would have to be true for the paper's table: factors one at a time, and jointly"
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "bench", metavar="BENCH", help="benchmark file, or the name of an embedded one"
    )
    varied = "what varies (default: sensitivity.toml beside this script)"
    parser.add_argument("--factors", type=Path, default=DEFAULT, metavar="FILE.toml", help=varied)
    parser.add_argument(
        "--parts", choices=list(PARTS), help="one of the two parts alone (default: both)"
    )
    measured(parser, studies, "sensitivity")


if __name__ == "__main__":
    main()
