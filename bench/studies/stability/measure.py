"""The stability study: every hard case."""

import time
import warnings
from collections.abc import Iterable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import pandas as pd

from handbench.bench.results.stability import StabilityFacts, counted, write_stability
from handbench.bench.results.tables import CASES, frame
from handbench.bench.studies.columns import markdown_table
from handbench.bench.studies.stability.cases import GROUPS, cases, measured
from handbench.bench.studies.study import carried_out, stand
from handbench.support.config import suggest
from handbench.support.cost import require_time
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

CASE_S = 0.25  # of processor time, on average
SHOWN = ["group", "case", "quantity", "bound", "kind", "measured", "unit", "verdict"]


def run_stability(groups: str | None = None, folder: Path | None = None) -> tuple[StabilityFacts, pd.DataFrame]:
    """Measure the cases of some groups (names with commas; None: all), and write them to `folder`, if one is given.
    Returns the facts, and the cases by `CASES`."""
    start, chosen = time.perf_counter(), cases(_groups(groups))
    require_time(CASE_S * len(chosen), f"stability: {len(chosen)} cases")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a warning without meaning would reach a user too
        found, _ = carried_out(chosen, measured, attrgetter("name"), "cases")
    table = frame(CASES, (line for _, line in found))
    kinds = {case.name: case.kind for case in chosen}
    facts = StabilityFacts(seconds=time.perf_counter() - start, kinds=kinds, **stand())
    if folder is not None:
        write_stability(folder, facts, table)
        say(f"stability: {folder / 'stability.csv'}")
    return facts, table


def _groups(text: str | None) -> tuple[str, ...]:
    chosen = GROUPS if text is None else tuple(part.strip() for part in text.split(","))
    for group in chosen:
        if group not in GROUPS:
            raise HandbenchError(f"--groups: unknown '{group}'; {suggest(group, list(GROUPS))}")
    return chosen


def show(facts: StabilityFacts, found: pd.DataFrame) -> None:
    """Print the cases on stdout."""
    print(markdown(SHOWN, found[SHOWN].itertuples(index=False)))
    print(f"{len(found)} hard cases in {facts.seconds:.0f} s: {counted(found)}")


def markdown(headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Rows of text and numbers as Markdown."""
    columns = dict(zip(headings, zip(*rows, strict=True), strict=True))
    texts = [any(isinstance(cell, str) for cell in cells) for cells in columns.values()]
    return markdown_table({heading: list(map(_cell, cells)) for heading, cells in columns.items()}, texts)


def _cell(value: Any) -> str:
    if value is None or value != value:  # NaN alone differs from itself
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
