"""A hard case: a sweep through the limit of something that can blow up and past it, as a test.

The sweep is a function without arguments that yields (place, value), or (place, value, True) where
the answer is marked as unreliable: by a flag, NaN or a stated σ that covers it. Its docstring is
the reason for the bound, which holds on every machine. Kinds of bounds:

derived   a formula of roundings, geometry or probability, a count or a promise
rigorous  derived, and the reference is ball arithmetic's, with a proven error
measured  chosen after seeing the figure
refusal   an error in words is the answer
"""

import inspect
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import SupportsFloat
from unittest.mock import patch

import numpy as np

from handbench.support.errors import HandbenchError
from tests.references import balls

U, U_SINGLE = (float(np.finfo(kind).eps) / 2 for kind in (np.float64, np.float32))  # unit roundoffs

Seen = Iterable[tuple[str, SupportsFloat] | tuple[str, SupportsFloat, bool]]
Works = Iterable[tuple[str, Callable[[], object]] | tuple[str, Callable[[], object], str]]


@dataclass(frozen=True)
class Worst:
    """The largest value of a sweep, and its place. flagged: it is beyond the bound, and all values
    beyond the bound are marked as unreliable."""

    value: float
    at: str
    flagged: bool = False


@dataclass(frozen=True)
class HardCase:
    """A hard case. quantity: what can blow up; reference: what it is compared with."""

    name: str
    kind: str
    bound: float
    unit: str
    quantity: str
    reference: str
    reason: str
    sweep: Callable[[], Seen]

    def worst(self) -> Worst:
        """The worst of the sweep, in which a warning is an error; NaN counts as infinite. Marked
        values beyond the bound count only where no other value is beyond it."""
        compared: list[int] = []
        count = patch.object(
            balls, "balls", lambda values, make=balls.balls: compared.append(1) or make(values)
        )
        with warnings.catch_warnings(), count:
            warnings.simplefilter("error")
            seen = [(at, float(value), any(marked)) for at, value, *marked in self.sweep()]
        assert compared or self.kind != "rigorous", "no comparison with ball arithmetic"
        seen = [(at, np.inf if np.isnan(value) else value, marked) for at, value, marked in seen]
        silent = [one for one in seen if one[1] > self.bound and not one[2]]
        at, value, _ = max(silent or seen, key=lambda one: one[1])
        return Worst(value, at, flagged=not silent and value > self.bound)


def hard_case(
    name: str,
    *,
    kind: str,
    bound: float,
    unit: str,
    quantity: str,
    reference: str,
    reason: str = "",
) -> Callable[[Callable[[], Seen]], Callable[[], None]]:
    """Make a sweep a test of its bound, with the case as its attribute `case`. reason: the bound's,
    where the sweep's docstring does not say it."""

    def decorate(sweep: Callable[[], Seen]) -> Callable[[], None]:
        why = reason or inspect.getdoc(sweep) or ""
        case = HardCase(name, kind, bound, unit, quantity, reference, why, sweep)

        def test() -> None:
            found = case.worst()
            assert found.value <= case.bound or found.flagged, (
                f"{name}: {quantity} is {found.value:.3g} {unit} at {found.at}; {why}"
            )

        test.__name__, test.__doc__, test.__module__ = sweep.__name__, why, sweep.__module__
        vars(test)["case"] = case
        return test

    return decorate


def refusal(name: str, *words: str) -> Callable[[Callable[[], Works]], Callable[[], None]]:
    """Make a test of a function that yields (place, work[, word]): each work must end in a
    HandbenchError that has all `words`, and its own word."""

    def decorate(works: Callable[[], Works]) -> Callable[[], None]:
        def sweep() -> Seen:
            for place, work, *own in works():
                yield _refused(place, work, (*words, *own))

        sweep.__name__, sweep.__doc__, sweep.__module__ = (
            works.__name__,
            works.__doc__,
            works.__module__,
        )
        words_of_table = {"unit": "answers", "quantity": "an answer", "reference": "a refusal"}
        return hard_case(name, kind="refusal", bound=0.0, **words_of_table)(sweep)

    return decorate


def _refused(place: str, work: Callable[[], object], words: tuple[str, ...]) -> tuple[str, float]:
    """The place and 0; 1 where the work is not refused, or its error lacks one of the words."""
    try:
        given = work()
    except HandbenchError as error:
        missing = [word for word in words if word not in str(error)]
        return (
            (f"{place}, whose error does not say {missing}: {error}", 1.0)
            if missing
            else (place, 0.0)
        )
    return f"{place}, which was answered: {type(given).__name__}", 1.0
