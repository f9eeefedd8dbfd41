"""Two result folders side by side, as `handbench compare` writes them.

compare.json  both sides, the basis, every difference, times and what differs in provenance
compare.csv   one line a method, metric and reference: `DIFFERENCES` in `bench.results.tables`
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd

from handbench.bench.results.tables import DIFFERENCES, records, write
from handbench.support.files import write_json

COMPARED_VERSION = 1


@dataclass(frozen=True)
class Side:
    """One of the two results. captures: those that it was scored on; gemm_gflops: its machine's rate of float32 matrix
    products."""

    folder: str
    name: str
    captures: tuple[str, ...]
    gemm_gflops: float | None


@dataclass(frozen=True, eq=False)
class Compared:
    """Two results side by side. basis: what the differences stand on, in sentences; differences, times, changes: as
    `bench.results.tables` declares them."""

    a: Side
    b: Side
    basis: tuple[str, ...]
    differences: pd.DataFrame
    times: pd.DataFrame
    changes: pd.DataFrame


def write_compared(folder: Path, compared: Compared) -> None:
    """Write compare.csv and compare.json."""
    write(folder / "compare.csv", compared.differences, DIFFERENCES)
    lines = {name: records(getattr(compared, name)) for name in ("differences", "times", "changes")}
    about = {"a": asdict(compared.a), "b": asdict(compared.b), "basis": compared.basis}
    write_json(folder / "compare.json", {"schema_version": COMPARED_VERSION, **about, **lines})
