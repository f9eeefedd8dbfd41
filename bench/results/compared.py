"""Two result folders side by side, as `handbench compare` writes them.

compare.json  both sides, the basis, every difference, times and what differs in provenance
compare.csv   one line a method, metric and reference: see `Difference`
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from bench.results.records import write_csv
from radar.support.files import write_json

COMPARED_VERSION = 1


@dataclass(frozen=True)
class Side:
    """One of the two results. captures: those that it was scored on; gemm_gflops: its machine's rate of float32 matrix
    products."""

    folder: str
    name: str
    captures: tuple[str, ...]
    gemm_gflops: float | None


@dataclass(frozen=True)
class Difference:
    """One line of compare.csv: a figure of A [a_low, a_high] and of B with 95 % intervals, and B − A [low, high], in
    `unit`. metric_title: as it is printed; p_corrected: after Holm over all lines; paired: on the same captures; n_a,
    n_b: captures; better: "A" or "B" where a difference is shown at 5 % for all lines together. reference: empty for
    the precision. None: unknown, or too little to test."""

    method: str
    title: str
    metric: str
    metric_title: str
    unit: str
    reference: str
    a: float | None
    a_low: float | None
    a_high: float | None
    b: float | None
    b_low: float | None
    b_high: float | None
    difference: float | None
    low: float | None
    high: float | None
    p_corrected: float | None
    paired: bool
    n_a: int
    n_b: int
    better: str = ""
    sentence: str = ""


@dataclass(frozen=True)
class Time:
    """Seconds per frame of A [a_low, a_high] and B with the 95 % intervals of their medians; ratio: B's over A's."""

    method: str
    title: str
    a: float | None
    a_low: float | None
    a_high: float | None
    b: float | None
    b_low: float | None
    b_high: float | None
    ratio: float | None
    sentence: str


@dataclass(frozen=True)
class Change:
    """One thing that the two results do not share. what: configuration, settings, version, machine, input."""

    what: str
    key: str
    a: str
    b: str


@dataclass(frozen=True)
class Compared:
    """Two results side by side. basis: what the differences stand on, in sentences."""

    a: Side
    b: Side
    basis: tuple[str, ...]
    differences: tuple[Difference, ...]
    times: tuple[Time, ...]
    changes: tuple[Change, ...]


def write_compared(folder: Path, compared: Compared) -> None:
    """Write compare.csv and compare.json."""
    write_csv(folder / "compare.csv", Difference, compared.differences)
    write_json(folder / "compare.json", {"schema_version": COMPARED_VERSION, **asdict(compared)})
