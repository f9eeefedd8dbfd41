"""The two parts of the study: each factor by itself, and a joint design, with the tables of each."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil

import pandas as pd

from bench.evaluation.metrics import METRICS, TITLES
from bench.results.tables import Column
from bench.run.sensitivity_table import Factors, SensitivityTable
from bench.studies.columns import Record, Table, columns
from bench.studies.sensitivity.cases import joint, one_at_a_time, shown
from bench.studies.sensitivity.figure import draw_map, draw_tornadoes
from bench.studies.sensitivity.measure import Measurement
from bench.studies.sensitivity.nearness import KEYS, PAPER, answer, factor_records
from bench.studies.study import Study

SHOWN = 10  # settings of the joint design on its page
SETTING = {column.name: column for column in columns("sensitivity.setting")}
TOLD = [SETTING[name] for name in ("number", "name", "factor", "values", "placement")]
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


def one_part(measurement: Measurement) -> Study:
    """Each factor by itself."""
    table = measurement.table
    others = [entry.id for entry in measurement.bench.method if entry not in measurement.entries.values()]
    left_out = f" Not of the paper's table, and left out: {', '.join(others)}." if others else ""
    text = ONE.format(frames=table.frames, repeats=measurement.bench.repeats, left_out=left_out)
    return Study(
        "one_at_a_time",
        "Sensitivity: one factor at a time",
        one_at_a_time(table),
        measurement,
        lambda records: [
            Table("rows", [*TOLD, *_figures(), *_spreads(), *VERDICT], records, shown=False),
            Table(
                "table", [_text("name", "setting"), *_texts(), *VERDICT[:2]], [_paper(), *map(_with_spread, records)]
            ),
            _ranges(table),
        ],
        draw_tornadoes,
        label=lambda case: case.name,
        seed=measurement.bench.seed,
        text=text,
    )


def joint_part(measurement: Measurement) -> Study:
    """The joint design."""
    table = measurement.table
    cases = joint(table)
    varied = {name: table.factor.listed()[name] for name in cases[0].values}

    def tables(records: list[Record]) -> list[Table]:
        settings = pd.DataFrame([r for r in records if r["distance"] == r["distance"]])
        settings = settings.sort_values("distance", ignore_index=True)
        nearest = settings.head(ceil(len(settings) * table.near_percent / 100))
        factors = factor_records(settings, varied, nearest)
        turned = settings.assign(distance=settings.turned.astype(float))
        below = turned[turned.distance > 0]
        order = factor_records(turned, varied, below) if len(below) else []
        words = answer(settings, len(cases), factors, order, table)
        given = [Column(n, str, Factors.model_fields[n].description or "", heading=n) for n in varied]
        near = [_in_words(record) for record in _records(settings.head(SHOWN))]
        every = [
            *TOLD,
            *(Column(n, object, c.meaning) for n, c in zip(varied, given, strict=True)),
            *_figures(),
            *VERDICT,
        ]
        known = columns("sensitivity.factors")
        return [
            Table("settings", every, _records(settings), shown=False),
            Table("nearest", [_text("name", "nearest"), *_figures(), *VERDICT[:2]], [_paper_numbers(), *near]),
            Table("values", [_text("name", "their values"), *given], near, note=words),
            Table("factors", known, [r | {"distance": "distance"} for r in factors]),
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
        seed=table.seed,
        text=JOINT.format(settings=table.settings, factors=len(varied), placements=table.placements, seed=table.seed),
    )


PARTS: dict[str, Callable[[Measurement], Study]] = {"one": one_part, "joint": joint_part}


def _split(name: str) -> tuple[str, str]:
    """Method and metric of a figure's name."""
    key = next(key for key in KEYS if name.endswith(key))
    return name.removesuffix(f"_{key}"), key


def _heading(name: str) -> str:
    family, key = _split(name)
    return f"{TITLES[family]} {METRICS[key].title.removesuffix(' of AE')}"


def _figures() -> list[Column]:
    return [Column(n, float, METRICS[_split(n)[1]].definition, "mm", heading=_heading(n), form="{:.2f}") for n in PAPER]


def _spreads() -> list[Column]:
    """Of the draws, in the files alone."""
    words = {"sd": "standard deviation", "low": "lowest", "high": "highest"}
    return [
        Column(f"{name}_{end}", float, f"{word} over the draws", "mm")
        for name in PAPER
        for end, word in words.items()
        if end == "sd" or "precision" not in name
    ]


def _text(name: str, heading: str) -> Column:
    return Column(name, str, SETTING["name"].meaning, heading=heading)


def _texts() -> list[Column]:
    return [Column(c.name, str, f"{c.meaning}, mm", heading=c.heading) for c in _figures()]


def _with_spread(record: Record) -> Record:
    """A setting with its figures as text, "6.05 ± 0.31"."""
    cells = {}
    for name in PAPER:
        value, sd = record.get(name), record.get(f"{name}_sd")
        if value is not None:
            cells[name] = f"{value:.2f}" + (f" ± {sd:.2f}" if sd is not None else "")
    return {**record, **cells}


def _paper() -> Record:
    return {"name": "the paper", **{name: f"{value:g}" for name, value in PAPER.items()}}


def _paper_numbers() -> Record:
    return {"name": "the paper", **PAPER}


def _records(settings: pd.DataFrame) -> list[Record]:
    return [{str(name): value for name, value in line.items()} for line in settings.to_dict("records")]


def _in_words(record: Record) -> Record:
    return {**record, **{n: shown(n, v) for n, v in record.items() if n in Factors.model_fields}}


def _ranges(table: SensitivityTable) -> Table:
    """The factors with their values and meanings."""
    records = [
        {
            "factor": name,
            "values": ", ".join(shown(name, value) for value in values),
            "meaning": Factors.model_fields[name].description,
        }
        for name, values in table.factor.listed().items()
    ]
    return Table("factors", columns("sensitivity.range"), records)
