"""Benchmark of the engine: time, error and memory of imaging and simulation, measured in one run.

Seconds vary with the state of the machine; compare the column ratio_to_exact, which relates times
of one run.
"""

from __future__ import annotations

from pathlib import Path

from handbench.bench.evaluation.tables import declared_tables
from handbench.bench.studies.engine.checks import growth
from handbench.bench.studies.engine.scope import QUICK, Inputs, Scope
from handbench.bench.studies.engine.volume_rows import frame_rows, simulation_rows, volume_rows
from handbench.bench.studies.study import Record, Study, Table, measured, parser

SECTIONS = {
    "volume": volume_rows,
    "3-FSK frame": frame_rows,
    "simulation": simulation_rows,
    "growth": growth,
}
SCHEMAS = declared_tables(__file__)


def study(work: Path, quick: bool) -> Study:
    """Make the benchmark of the engine: time, error and memory of imaging a volume, of a 3-FSK
    frame and of a simulation, and how cost grows with size. quick: use a small volume."""
    inputs = Inputs(QUICK if quick else Scope())
    return Study("engine", list(SECTIONS), lambda name: SECTIONS[name](inputs), tables)


def tables(records: list[Record]) -> list[Table]:
    """Make two tables from the records: times, errors and memory by section, and the growth of cost
    with size."""
    rows, grown = ([r for r in records if ("method" in r) == of] for of in (True, False))
    return [
        Table("rows", SCHEMAS["rows"].columns, rows, by="section"),
        Table("growth", SCHEMAS["growth"].columns, grown),
    ]


def main() -> None:
    """Measure time, error and memory of imaging and simulation in comparison with exact and
    textbook sums, and how they grow with size; write and print the tables."""
    purpose = "what imaging and simulation cost in time, error and memory, and how that grows"
    options = parser("engine.measure_engine", purpose)
    quick = "a small volume, in two minutes: does it all run?"
    options.add_argument("--quick", action="store_true", help=quick)
    measured(options, study, "engine")


if __name__ == "__main__":
    main()
