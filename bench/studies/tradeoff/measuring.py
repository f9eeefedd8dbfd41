"""Measurements of the sweep: failures that do not end it, seconds of interleaved rounds, and facts of the machine."""

import time
import traceback
from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any, TypeVar

from handbench.radar.imaging.device import describe
from handbench.support.cost import calibrated_machine
from handbench.support.errors import HandbenchError
from handbench.support.progress import say, track
from handbench.support.store import versions

Key = TypeVar("Key", bound=Hashable)
T = TypeVar("T")


def carried_out(
    cases: Iterable[Any], measure: Callable[[Any], Any], label: Callable[[Any], str], title: str
) -> tuple[list[tuple[Any, Any]], dict[str, str]]:
    """Measure every case.

    Returns (case, result) of those that succeed, and label → message of those that fail. A failure is printed, with
    the traceback of an unknown error, and the other cases go on.
    """
    measured = []
    failures = {}
    for case in track(list(cases), title):
        try:
            measured.append((case, measure(case)))
        except HandbenchError as error:
            failures[label(case)] = str(error)
            say(f"{title}: {label(case)} failed: {error}")
        except Exception as error:
            failures[label(case)] = f"{type(error).__name__}: {error}"
            say(traceback.format_exc())
    return measured, failures


def in_turns(
    work: Mapping[Key, Callable[[], T]], rounds: int, title: str
) -> tuple[dict[Key, list[float]], dict[Key, T]]:
    """Do each piece of work once a round, so that a machine that gets slower does so for all of them.

    Returns the seconds [rounds] and the last result of each.
    """
    seconds: dict[Key, list[float]] = {key: [] for key in work}
    results: dict[Key, T] = {}
    for _ in track(range(rounds), title):
        for key, once in work.items():
            start = time.perf_counter()
            results[key] = once()
            seconds[key].append(time.perf_counter() - start)
    return seconds, results


def stand() -> dict[str, Any]:
    """Facts of the machine, its rate of float32 matrix products and its imaging device, and versions of libraries."""
    return {"machine": {**calibrated_machine(), "imaging_device": describe()}, "versions": versions()}
