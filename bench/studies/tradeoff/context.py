"""The context that every section of a trade-off is given."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # they import what declares the sweep
    from bench.run.benchmark_file import BenchFile
    from bench.run.outcome import Capture


@dataclass(frozen=True)
class Context:
    """bench: the benchmark, whose paths start from `base`; work: the claimed folder for kept stages; captures: opened,
    folders with echoes, photographs and truth as far as they have them; repeats: timed rounds, interleaved."""

    bench: BenchFile
    base: Path
    work: Path
    captures: list[Capture]
    seed: int
    repeats: int
