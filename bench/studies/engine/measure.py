"""The engine's benchmark: what imaging and simulation cost, measured in one run.

Seconds drift with the machine; ratio_to_exact, within one run, is what counts.
"""

from dataclasses import replace
from pathlib import Path

from bench.studies.columns import Record, Table, columns
from bench.studies.engine.checks import bars, compilation, growth, thread_differences
from bench.studies.engine.figure import draw
from bench.studies.engine.frame_rows import frame_rows, simulation_rows
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


def study(work: Path, quick: bool, full: bool) -> Study:
    """Sections one after the other; full: the exact volume is measured whole."""
    scope = QUICK if quick else Scope()
    inputs = Inputs(replace(scope, exact_planes=None) if full else scope)
    title = "What imaging and simulation cost"
    return Study("engine", title, list(SECTIONS), lambda name: SECTIONS[name](inputs), tables, draw)


def tables(records: list[Record]) -> list[Table]:
    """Rows by section, growth, and the bars."""
    of_rows, of_growth = ([r for r in records if r["section"] in names] for names in (OF_ROWS, ("growth",)))
    return [
        Table("rows", columns("engine.rows"), of_rows, by="section"),
        Table("growth", columns("engine.growth"), of_growth),
        Table("bars", columns("engine.bars"), bars(records)),
    ]
