"""The captures and methods of a result's table, chosen so that every method has every capture."""

from collections.abc import Sequence
from dataclasses import dataclass

from handbench.bench.benchmarks.benchmark_file import BenchFile, MethodEntry
from handbench.bench.results.about import Failure
from handbench.bench.run.captures import RunCapture
from handbench.support.errors import HandbenchError


@dataclass(frozen=True)
class CommonSubset:
    """The captures and methods of a result's table.
    captures: those for the accuracy; repeated: those for the precision; text: words that say how
    many captures and which methods were left out."""

    captures: tuple[RunCapture, ...]
    methods: tuple[MethodEntry, ...]
    text: str
    repeated: tuple[RunCapture, ...]

    @property
    def all_captures(self) -> tuple[RunCapture, ...]:
        """The captures for the accuracy, followed by those that measure only the precision."""
        further = [capture for capture in self.repeated if capture not in self.captures]
        return (*self.captures, *further)


def common_subset(
    bench: BenchFile, captures: Sequence[RunCapture], failures: Sequence[Failure]
) -> CommonSubset:
    """Select the captures and methods of the result's table, so that every method has every
    capture.

    captures: those that were opened. The accuracy uses the captures for which all selected methods
    finished every stage. A method that finished fewer than half as many captures as the best one is
    left out, because it would remove the other methods' captures. While no capture is common to all
    methods, the one with the fewest captures is left out too. Raises HandbenchError if nothing
    remains.

    The precision uses those of the selected captures that measure it. Captures that measure only
    the precision are added if all methods with a precision finished them. Methods are left out of
    the precision by the same rule, and stay in the table.
    """
    lost = {(failure.capture, failure.method) for failure in failures}

    def finished(some: Sequence[RunCapture], methods: Sequence[str]) -> dict[str, set[str]]:
        """Find the captures for which each method finished every stage."""
        return {
            method: {c.name for c in some if not lost & {(c.name, ""), (c.name, method)}}
            for method in methods
        }

    labels = [entry.label for entry in bench.method]
    scored = finished([capture for capture in captures if capture.accurate], labels)
    kept, common = _shared(scored)
    if not kept:
        raise HandbenchError(f"every capture failed; the error of the first: {failures[0].message}")
    total = sum("accuracy" in source.measures for source in bench.capture)
    text = _basis(scored, kept, common, total)
    precise = [entry.label for entry in bench.method if entry.label in kept and entry.precision]
    repeated = finished([capture for capture in captures if not capture.accurate], precise)
    steady, further = _shared(repeated)
    if precise and (total := sum(s.measures == ("precision",) for s in bench.capture)):
        text += f"; for the precision only: {_basis(repeated, steady, further, total)}"
    return CommonSubset(
        tuple(capture for capture in captures if capture.name in common),
        tuple(entry for entry in bench.method if entry.label in kept),
        text,
        tuple(
            capture
            for capture in captures
            if capture.name in common | further and "precision" in capture.measures
        ),
    )


def _shared(finished: dict[str, set[str]]) -> tuple[list[str], set[str]]:
    """Choose the methods that stay in the table; return them, and the captures that all of them
    finished.
    finished: method → names of the captures that it finished. Methods with fewer than half as many
    captures as the best one are left out; then the weakest ones, while no capture is common to
    all."""
    most = max(map(len, finished.values()), default=0)
    kept = [id for id, names in finished.items() if 2 * len(names) >= most > 0]
    while kept and not set.intersection(*(finished[id] for id in kept)):
        kept.remove(min(reversed(kept), key=lambda id: len(finished[id])))
    return kept, set.intersection(*(finished[id] for id in kept)) if kept else set()


def _basis(finished: dict[str, set[str]], kept: list[str], common: set[str], total: int) -> str:
    text = f"{len(common)} of {total} captures: those that every method of the table finished"
    without = [
        f"{method} ({len(names)} of {total})"
        for method, names in finished.items()
        if method not in kept
    ]
    return text + (
        f"; methods left out, with the captures that they finished: {', '.join(without)}"
        if without
        else ""
    )
