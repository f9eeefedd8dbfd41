"""The catalogue of hard cases: functions that measure one quantity each, swept through its limit and past it.

A case returns the worst value that it saw; or `Worst`, which says where in the sweep that was and whether wrong values
were flagged; or `Refused`, where no answer is the right one. A bound holds on every machine, for the reason beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from bench.results.stability import HardCase
from radar.support.errors import HandbenchError

GROUPS = ("phase", "data", "geometry", "smoothing", "registration", "meshes", "statistics")


@dataclass(frozen=True)
class Worst:
    """The largest value that a sweep saw, and where. flagged: it is beyond the bound somewhere, and exactly there the
    answer was marked as unreliable (a flag, NaN, or a stated σ that covers it)."""

    value: float
    at: str = ""
    flagged: bool = False


@dataclass(frozen=True)
class Refused:
    """The right answer to the case is an error in words: this one was given."""

    message: str


@dataclass(frozen=True)
class Case:
    """A hard case; see `HardCase` for the fields."""

    name: str
    group: str
    quantity: str
    reference: str
    unit: str
    bound: float
    reason: str
    measure: Callable[[], float | Worst | Refused]


CASES: dict[str, Case] = {}

Measure = Callable[[], float | Worst | Refused]


def case(
    group: str, name: str, *, quantity: str, reference: str, unit: str, bound: float, reason: str
) -> Callable[[Measure], Measure]:
    """Decorator that enters a measuring function into the catalogue."""

    def add(measure: Measure) -> Measure:
        if group not in GROUPS or name in CASES:
            raise ValueError(f"case '{name}' of '{group}': the group is unknown or the name is taken")
        CASES[name] = Case(name, group, quantity, reference, unit, bound, reason, measure)
        return measure

    return add


def cases(groups: Iterable[str] = GROUPS) -> list[Case]:
    """The catalogue's cases of some groups, in the order of the groups."""
    for group in groups:
        import_module(f"bench.studies.stability.{group}_cases")
    return [c for group in groups for c in CASES.values() if c.group == group]


def refused(work: Callable[[], Any], *words: str) -> Refused | Worst:
    """Have `work` refuse with a HandbenchError in which all `words` stand; anything else is infinitely wrong."""
    try:
        given = work()
    except HandbenchError as error:
        missing = ", ".join(word for word in words if word not in str(error))
        return Worst(np.inf, f"its error does not say {missing}: {error}") if missing else Refused(str(error))
    return Worst(np.inf, f"was not refused but answered {type(given).__name__}")


def refused_throughout(works: Mapping[str, Callable[[], Any]], *words: str) -> Refused | Worst:
    """`refused` for each of `works` (place in the sweep → what is to refuse); the first that is answered, if any."""
    for place, work in works.items():
        found = refused(work, *words)
        if isinstance(found, Worst):
            return Worst(found.value, f"{place}: {found.at}")
    return found


def worst(seen: Iterable[tuple[str, float]]) -> Worst:
    """The largest of (place, value); a value that is no number counts as infinite."""
    values = [(np.inf if np.isnan(value) else float(value), place) for place, value in seen]
    value, place = max(values, key=lambda pair: pair[0])
    return Worst(value, place)


def measured(chosen: Case) -> HardCase:
    """Carry a case out. An exception that is no answer is a failure of the case, not of the run."""
    start = time.perf_counter()
    try:
        found = chosen.measure()
    except Exception as error:
        found = Worst(np.inf, f"{type(error).__name__}: {error}")
    value, at, verdict = _judged(found, chosen.bound)
    seconds = time.perf_counter() - start
    return HardCase(
        chosen.name,
        chosen.group,
        chosen.quantity,
        chosen.reference,
        chosen.unit,
        chosen.bound,
        value,
        verdict,
        at,
        chosen.reason,
        seconds,
    )


def _judged(found: float | Worst | Refused, bound: float) -> tuple[float | None, str, str]:
    if isinstance(found, Refused):
        return None, found.message, "refused"
    found = found if isinstance(found, Worst) else Worst(float(found))
    if found.value <= bound:
        return found.value, found.at, "holds"
    return found.value, found.at, "flagged" if found.flagged else "fails"
