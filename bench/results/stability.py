"""What `handbench stability` writes, beside the result that a report shows it with.

stability.csv    one line a hard case: see `HardCase`
stability.json   schema_version, name, tables beside the cases (float32 errors, amplification, random scenes), versions,
                 machine, seed
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from bench.results.tables import CASES, frame, read, records, write
from radar.support.config import Config, parse
from radar.support.files import read_json, write_json

STABILITY_VERSION = 1
VERDICTS = ("holds", "refused", "flagged", "fails")


@dataclass(frozen=True)
class HardCase:
    """One line of stability.csv. quantity: what could blow up; reference: what it is compared with; bound and measured
    in `unit`, with the bound's reason; at: where in the sweep the worst was seen. verdict: holds (within the bound),
    refused (by an error in words), flagged (wrong, and every wrong value was marked as such), fails."""

    case: str
    group: str
    quantity: str
    reference: str
    unit: str
    bound: float | None
    measured: float | None
    verdict: str
    at: str
    reason: str
    seconds: float | None


class Table(Config):
    """A table beside the cases: columns and rows of text and numbers, and what it shows in a sentence."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | int | None, ...], ...]


class StabilityFacts(Config):
    """Content of stability.json."""

    schema_version: Literal[1] = STABILITY_VERSION
    seed: int
    seconds: float
    tables: tuple[Table, ...] = ()
    versions: dict[str, str] = Field(default_factory=dict)
    machine: dict[str, Any] = Field(default_factory=dict)


def write_stability(folder: Path, facts: StabilityFacts, cases: Iterable[HardCase]) -> None:
    """Write stability.csv, then stability.json, which says that it is complete."""
    write(folder / "stability.csv", frame(CASES, map(asdict, cases)), CASES)
    write_json(folder / "stability.json", facts.model_dump(mode="json"))


def load_stability(folder: str | Path) -> tuple[StabilityFacts, tuple[HardCase, ...]]:
    """Read both; what is missing or broken is a HandbenchError."""
    folder = Path(folder)
    content = read_json(folder / "stability.json", "a stability run")
    facts = parse(StabilityFacts, content, str(folder / "stability.json"))
    return facts, tuple(HardCase(**line) for line in records(read(folder / "stability.csv", CASES)))
