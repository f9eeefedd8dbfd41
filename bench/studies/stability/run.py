"""The stability run: every case, then the tables of errors that no single case shows."""

from __future__ import annotations

import time
import warnings
from importlib import import_module
from pathlib import Path

from bench.results.stability import VERDICTS, HardCase, StabilityFacts, Table, write_stability
from bench.studies.stability.cases import GROUPS, cases, measured
from radar.support.config import suggest
from radar.support.cost import calibrated_machine
from radar.support.errors import HandbenchError
from radar.support.progress import say, track
from radar.support.store import versions

STYLES = {"holds": "green", "refused": "cyan", "flagged": "yellow", "fails": "bold red"}


def run_stability(
    groups: str | None = None, seed: int = 0, scenes: int = 10_000, folder: Path | None = None
) -> tuple[StabilityFacts, list[HardCase]]:
    """Measure the cases of some groups (names with commas; None: all, and the tables), and write them to `folder`, if
    one is given. scenes: random hard scenes, drawn from `seed`."""
    start, chosen = time.perf_counter(), _groups(groups)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a warning without meaning would reach a user too
        found = [measured(case) for case in track(cases(chosen), "cases")]
        tables = () if groups else _tables(seed, scenes)
    facts = StabilityFacts(
        seed=seed, seconds=time.perf_counter() - start, tables=tables, versions=versions(), machine=calibrated_machine()
    )
    if folder is not None:
        write_stability(folder, facts, found)
        say(f"stability: {folder / 'stability.csv'}")
    return facts, found


def _groups(text: str | None) -> tuple[str, ...]:
    chosen = GROUPS if text is None else tuple(part.strip() for part in text.split(","))
    for group in chosen:
        if group not in GROUPS:
            raise HandbenchError(f"--groups: unknown '{group}'; {suggest(group, list(GROUPS))}")
    return chosen


def _tables(seed: int, scenes: int) -> tuple[Table, ...]:
    """Errors of single precision, how much estimators amplify, and random scenes."""
    precision, condition, random = (
        import_module(f"bench.studies.stability.{name}")
        for name in ("precision_cases", "condition_cases", "random_scenes")
    )
    tables = (precision.table(), condition.table())
    return (*tables, random.table(seed, scenes)) if scenes else tables


def show(facts: StabilityFacts, found: list[HardCase]) -> None:
    """Print the cases, then the tables, on stdout."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as Shown
    from rich.text import Text

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 200
    shown = Shown(box=box.SIMPLE, pad_edge=False)
    for heading in ("group", "case", "quantity", "bound", "measured", "unit", "verdict"):
        shown.add_column(heading, justify="right" if heading in ("bound", "measured") else "left")
    for case in found:
        cells = (case.group, case.case, case.quantity, _number(case.bound), _number(case.measured), case.unit)
        shown.add_row(*map(Text, cells), Text(case.verdict, STYLES[case.verdict]))
    console.print(shown)
    for table in facts.tables:
        console.print(_rich(table))
    counts = ", ".join(f"{sum(c.verdict == verdict for c in found)} {verdict}" for verdict in VERDICTS)
    console.print(f"{len(found)} hard cases in {facts.seconds:.0f} s: {counts}")


def _rich(table: Table):
    from rich import box
    from rich.table import Table as Shown
    from rich.text import Text

    shown = Shown(title=Text(f"{table.title}: {table.text}"), title_justify="left", box=box.SIMPLE, pad_edge=False)
    for column in table.columns:
        shown.add_column(Text(column))
    for row in table.rows:
        shown.add_row(*(Text(_number(cell) if isinstance(cell, float) else str(cell or "–")) for cell in row))
    return shown


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
