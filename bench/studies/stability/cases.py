"""The catalogue of hard cases: functions that measure one quantity each, swept through its limit and past it.

A measuring function yields what it saw: (place in the sweep, value), or (place, value, whether the answer was marked
as unreliable there, by a flag, NaN or a stated σ that covers it). One that must be refused yields (place, what is to
be refused). A bound holds on every machine, for the reason beside it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from radar.support.errors import HandbenchError

GROUPS = ("phase", "data", "geometry", "smoothing", "registration", "meshes", "statistics")
TEXT = re.compile(r"(.*?)\. Against: (.*?)\. Because: (.*)\.")  # of a measuring function, in its docstring


@dataclass(frozen=True)
class Worst:
    """The largest value that a sweep saw, and where. flagged: it is beyond the bound somewhere, and exactly there the
    answer was marked as unreliable."""

    value: float
    at: str = ""
    flagged: bool = False


@dataclass(frozen=True)
class Refused:
    """The right answer to the case is an error in words: this one was given."""

    message: str


Seen = float | Iterable[tuple[str, float]] | Iterable[tuple[str, float, bool]]
Works = Iterable[tuple[str, Callable[[], Any]]] | Iterable[tuple[str, Callable[[], Any], str]]


@dataclass(frozen=True)
class Case:
    """A hard case; `bench.results.tables.CASES` says what the fields are."""

    name: str
    group: str
    quantity: str
    reference: str
    unit: str
    bound: float
    reason: str
    measure: Callable[[], Seen | Worst | Refused]


CASES: dict[str, Case] = {}


def case(group: str, name: str, unit: str, bound: float) -> Callable[[Callable[[], Seen]], Callable[[], Seen]]:
    """Decorator that enters a measuring function into the catalogue.

    The function's docstring is the case's text, "Quantity. Against: reference. Because: the bound's reason."; {NAME}
    in it stands for a value of its module.
    """

    def add(measure: Callable[[], Seen]) -> Callable[[], Seen]:
        enter(group, name, unit, bound, measure.__doc__.format_map(measure.__globals__), measure)
        return measure

    return add


def refusal(
    group: str, name: str, *words: str, unit: str = "answers"
) -> Callable[[Callable[[], Works]], Callable[[], Works]]:
    """Decorator of a case whose right answer is an error with all `words`: whatever the function yields must refuse.

    Its docstring is as of `case`, or the reason alone: then the quantity is an answer, and the reference a refusal.
    """

    def add(works: Callable[[], Works]) -> Callable[[], Works]:
        text = works.__doc__.format_map(works.__globals__)
        text = text if "Against: " in text else f"An answer. Against: a refusal. Because: {text[0].lower()}{text[1:]}"
        enter(group, name, unit, 0.0, text, lambda: refused_throughout(works(), *words))
        return works

    return add


def enter(group: str, name: str, unit: str, bound: float, text: str, measure: Callable[[], Any]) -> None:
    """Enter a case into the catalogue, with a text as `case` explains it."""
    parts = TEXT.fullmatch(" ".join(text.split()))
    if group not in GROUPS or name in CASES or parts is None:
        raise ValueError(f"case '{name}' of '{group}': the group is unknown, the name is taken, or its text is: {text}")
    quantity, reference, reason = parts.groups()
    CASES[name] = Case(name, group, quantity[0].lower() + quantity[1:], reference, unit, bound, reason, measure)


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


def refused_throughout(works: Works, *words: str) -> Refused | Worst:
    """`refused` for each of `works` (place in the sweep, what is to refuse[, further words]); the first that is
    answered, if any."""
    found: Refused | Worst = Worst(np.inf, "nothing was tried")
    for place, work, *further in works:
        found = refused(work, *words, *further)
        if isinstance(found, Worst):
            return Worst(found.value, f"{place}: {found.at}")
    return found


def worst(seen: Iterable[tuple], bound: float = np.inf) -> Worst:
    """The largest of (place, value[, whether it was marked]); a value that is no number counts as infinite. Marked
    values beyond the bound count only where no other is beyond it: then the case is flagged."""
    values = [(place, np.inf if np.isnan(value) else float(value), any(marked)) for place, value, *marked in seen]
    silent = [one for one in values if one[1] > bound and not one[2]]
    place, value, _ = max(silent or values, key=lambda one: one[1])
    return Worst(value, place, flagged=not silent and value > bound)


def measured(chosen: Case) -> dict[str, Any]:
    """Carry a case out: its line of stability.csv. An exception that is no answer is a failure of the case, not of the
    run."""
    start = time.perf_counter()
    try:
        found = chosen.measure()
        if not isinstance(found, Refused | Worst):
            found = worst([("", found)] if np.isscalar(found) else found, chosen.bound)
    except Exception as error:
        found = Worst(np.inf, f"{type(error).__name__}: {error}")
    line = {name: value for name, value in vars(chosen).items() if name not in ("name", "measure")}
    line |= {"case": chosen.name, "seconds": time.perf_counter() - start}
    if isinstance(found, Refused):
        return {**line, "measured": None, "at": found.message, "verdict": "refused"}
    verdict = "holds" if found.value <= chosen.bound else "flagged" if found.flagged else "fails"
    return {**line, "measured": found.value, "at": found.at, "verdict": verdict}
