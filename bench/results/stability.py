"""Files that `handbench stability` writes, beside the result that a report shows it with.

stability.csv    one line a hard case: see `bench.results.tables.CASES`
stability.json   schema_version, kind of each case's bound, tables beside the cases (digits, random scenes: of
                 `tests/bench/studies/stability/measure_tables.py`, with its seed), seconds, versions, machine
"""

from pathlib import Path
from typing import Any, Literal

import pandas as pd
from pydantic import Field

from handbench.bench.results.tables import CASES, read, write
from handbench.support.config import Config, parse
from handbench.support.files import read_json, write_json

VERDICTS = ("holds", "refused", "flagged", "fails")
KINDS = {
    "derived": "a formula of roundings, geometry or probability, a count or a promise",
    "rigorous": "derived, and the reference is ball arithmetic's, with a proven error",
    "measured": "chosen after seeing the figure",
    "refusal": "an error in words is the answer",
}


class Table(Config):
    """A table beside the cases: columns and rows of text and numbers, and what it shows in a sentence."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | int | None, ...], ...]


class StabilityFacts(Config):
    """Content of stability.json."""

    schema_version: Literal[1] = 1
    seed: int = 0
    seconds: float
    kinds: dict[str, str] = Field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    versions: dict[str, str] = Field(default_factory=dict)
    machine: dict[str, Any] = Field(default_factory=dict)


def write_stability(folder: Path, facts: StabilityFacts, cases: pd.DataFrame) -> None:
    """Write stability.csv, then stability.json, which says that it is complete."""
    write(folder / "stability.csv", cases, CASES)
    write_json(folder / "stability.json", facts.model_dump(mode="json"))


def load_stability(folder: str | Path) -> tuple[StabilityFacts, pd.DataFrame]:
    """Read both, the cases by the columns of `CASES`; what is missing or broken is a HandbenchError."""
    folder = Path(folder)
    content = read_json(folder / "stability.json", "a stability run")
    return parse(StabilityFacts, content, str(folder / "stability.json")), read(folder / "stability.csv", CASES)


def counted(cases: pd.DataFrame) -> str:
    """Number of cases of each verdict and of each kind of bound, in words."""
    verdicts = ", ".join(f"{(cases.verdict == verdict).sum()} {verdict}" for verdict in VERDICTS)
    return f"{verdicts}; bounds: " + ", ".join(
        f"{(cases.kind == kind).sum()} {kind}" for kind in KINDS if kind != "refusal"
    )
