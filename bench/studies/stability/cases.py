"""The catalogue of hard cases: functions that measure one quantity each, swept through its limit and past it.

catalogue.toml says what each case GROUP.NAME is about; the function _NAME of a module GROUP_*.py measures it. It yields
what it saw: (place in the sweep, value), or (place, value, whether the answer was marked as unreliable there, by a
flag, NaN or a stated σ that covers it). Of a case that must be refused it yields (place, what is to be refused[, words
of that refusal alone]). A bound holds on every machine, for the reason beside it; `bench.results.stability.KINDS` says
where it comes from. The catalogue has a number for a bound only where it is 0, 1 (of what the function itself allows)
or measured; all others are formulas among the module's BOUNDS.
"""

import time
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np

from handbench.support.errors import HandbenchError

GROUPS = ("phase", "data", "geometry", "smoothing", "registration", "meshes", "statistics")
CATALOGUE = Path(__file__).with_name("catalogue.toml")
U, U_SINGLE = (float(np.finfo(kind).eps) / 2 for kind in (np.float64, np.float32))  # unit roundoffs
# Unless the catalogue says otherwise.
REFUSAL = {"bound": 0.0, "kind": "refusal", "unit": "answers", "quantity": "an answer", "reference": "a refusal"}


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


Seen = Iterable[tuple[str, SupportsFloat] | tuple[str, SupportsFloat, bool]]
Works = Iterable[tuple[str, Callable[[], object]] | tuple[str, Callable[[], object], str]]


@dataclass(frozen=True)
class Case:
    """A hard case; `bench.results.tables.CASES` says what the fields are."""

    name: str
    group: str
    quantity: str
    reference: str
    unit: str
    bound: float
    kind: str
    reason: str
    measure: Callable[[], Any]


def cases(groups: Iterable[str] = GROUPS) -> list[Case]:
    """The catalogue's cases of some groups, in its order."""
    catalogue, found = tomllib.loads(CATALOGUE.read_text("utf-8")), []
    for group in groups:
        files = sorted(CATALOGUE.parent.glob(f"{group}_*.py"))
        modules = [vars(import_module(f"{__package__}.{file.stem}")) for file in files]
        known = {name: text for name, text in catalogue[group].items() if isinstance(text, str)}
        for name, about in catalogue[group].items():
            if name not in known:
                module = next(module for module in modules if f"_{name}" in module)
                found.append(_case(group, name, about, known, module))
    return found


def _case(group: str, name: str, about: dict[str, Any], known: dict[str, str], module: dict[str, Any]) -> Case:
    """The case as the catalogue has it; known: the group's texts, by the names that stand for them."""
    measure, words = module[f"_{name}"], about.pop("words", None)
    if words is not None:
        about, measure = REFUSAL | about, partial(refused_throughout, measure, *words)
    bound = about.pop("bound") if "bound" in about else module["BOUNDS"][name]
    return Case(group=group, bound=bound, measure=measure, **{key: text.format(**known) for key, text in about.items()})


def refused(work: Callable[[], Any], *words: str) -> Refused | Worst:
    """Have `work` refuse with a HandbenchError in which all `words` stand; anything else is infinitely wrong."""
    try:
        given = work()
    except HandbenchError as error:
        missing = ", ".join(word for word in words if word not in str(error))
        return Worst(np.inf, f"its error does not say {missing}: {error}") if missing else Refused(str(error))
    return Worst(np.inf, f"was not refused but answered {type(given).__name__}")


def refused_throughout(works: Callable[[], Works], *words: str) -> Refused | Worst:
    """`refused` for each of works(); the first that is answered, if any."""
    found: Refused | Worst = Worst(np.inf, "nothing was tried")
    for place, work, *further in works():
        found = refused(work, *words, *further)
        if isinstance(found, Worst):
            return Worst(found.value, f"{place}: {found.at}")
    return found


def worst(seen: Seen, bound: float = np.inf) -> Worst:
    """The largest of (place, value[, whether it was marked]); a value that is no number counts as infinite. Marked
    values beyond the bound count only where no other is beyond it: then the case is flagged."""
    values = [(place, float(value), any(marked)) for place, value, *marked in seen]
    values = [(place, np.inf if np.isnan(value) else value, marked) for place, value, marked in values]
    silent = [one for one in values if one[1] > bound and not one[2]]
    place, value, _ = max(silent or values, key=lambda one: one[1])
    return Worst(value, place, flagged=not silent and value > bound)


def measured(chosen: Case) -> dict[str, Any]:
    """Carry a case out: its line of stability.csv. An exception that is no answer is a failure of the case, not of the
    run."""
    start = time.perf_counter()
    try:
        found: Refused | Worst | float | Seen = chosen.measure()
        if not isinstance(found, Refused | Worst):
            found = worst([("", found)] if isinstance(found, float | int) else found, chosen.bound)
    except Exception as error:
        found = Worst(np.inf, f"{type(error).__name__}: {error}")
    line = {name: value for name, value in vars(chosen).items() if name not in ("name", "measure")}
    line |= {"case": chosen.name, "seconds": time.perf_counter() - start}
    if isinstance(found, Refused):
        return {**line, "measured": None, "at": found.message, "verdict": "refused"}
    verdict = "holds" if found.value <= chosen.bound else "flagged" if found.flagged else "fails"
    return {**line, "measured": found.value, "at": found.at, "verdict": verdict}
