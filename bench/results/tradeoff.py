"""The folder of a trade-off: time and accuracy of each setting of each stage.

tradeoff.json   schema_version, name, sections (metric, unit, which time is counted, reference
                setting), claims, captures, inputs, versions, machine, facts
tradeoff.csv    one line per setting, with the fields of `Setting`
config.toml     the benchmark with its varied parameters, resolved
settings/       NAME.toml: each imaging setting as a benchmark for `handbench run`
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from handbench.bench.evaluation.tables import SETTINGS, frame, read, records, write
from handbench.bench.results.about import read_facts
from handbench.support.config import Config, Name
from handbench.support.files import require_folder, write_json


@dataclass(frozen=True)
class Setting:
    """One setting of a trade-off, with its error and its time: a line of tradeoff.csv.
    `bench.evaluation.tables.SETTINGS` explains the fields. None: unknown."""

    section: str
    name: str
    title: str
    knobs: str
    metric: str
    error: float | None = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    seconds: float | None = None
    seconds_low: float | None = None
    seconds_high: float | None = None
    ratio: float | None = None
    acquisition_s: float | None = None
    plan_s: float | None = None
    operations: float | None = None
    peak_memory_mb: float | None = None
    on_front: bool = False
    dominated_by: str = ""
    on_method_front: bool = False
    seen_percent: float | None = None

    @property
    def method(self) -> str:
        """The id of the imaging method that the setting uses; "" for a setting of another stage."""
        try:
            knobs = json.loads(self.knobs)
        except ValueError:
            return ""
        return str(knobs.get("method", "")) if isinstance(knobs, dict) else ""


class Section(Config):
    """One stage whose settings a trade-off compares.
    metric, unit, definition: of its error; seconds: which time is counted, in words; reference: the
    setting whose time is 1 in ratios of times."""

    name: Literal["imaging", "groundtruth"]
    title: str
    metric: str
    unit: str
    definition: str
    seconds: str
    reference: str


class Claim(Config):
    """A statement of the paper that one method is some times faster than another.
    paper: the stated factor; counted: the factor by numbers of operations; measured: the factor by
    the times measured here."""

    text: str
    paper: float
    counted: float | None = None
    measured: float | None = None
    note: str = ""


class TradeoffFacts(Config):
    """Content of tradeoff.json: which stages were compared and how, statements of the paper,
    captures, versions and machine."""

    schema_version: Literal[1] = 1
    name: Name
    scored_against: str
    sections: tuple[Section, ...]
    claims: tuple[Claim, ...] = ()
    captures: tuple[str, ...] = ()
    inputs: dict[str, str] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    machine: dict[str, Any] = Field(default_factory=dict)
    facts: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True)
class Tradeoff:
    """A trade-off folder that has been read: the content of tradeoff.json and all settings."""

    folder: Path
    facts: TradeoffFacts
    settings: tuple[Setting, ...]

    def section(self, name: str) -> tuple[Setting, ...]:
        """Return the settings of one section (such as "imaging" or "groundtruth"), in the order of
        tradeoff.csv."""
        return tuple(setting for setting in self.settings if setting.section == name)


def write_tradeoff(folder: Path, facts: TradeoffFacts, settings: Iterable[Setting]) -> None:
    """Write tradeoff.csv, then tradeoff.json, which marks the folder as complete."""
    write(folder / "tradeoff.csv", frame(SETTINGS, map(asdict, settings)), SETTINGS)
    write_json(folder / "tradeoff.json", facts.model_dump(mode="json"))


def load_tradeoff(folder: str | Path) -> Tradeoff:
    """Read and check a trade-off folder. Raises HandbenchError if it is missing, damaged or of
    another version."""
    folder = require_folder(folder, "a trade-off (tradeoff.json)")
    facts = read_facts(
        TradeoffFacts, folder / "tradeoff.json", "a trade-off", "run `handbench tradeoff` again"
    )
    lines = records(read(folder / "tradeoff.csv", SETTINGS))
    return Tradeoff(folder, facts, tuple(Setting(**line) for line in lines))
