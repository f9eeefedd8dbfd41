"""A sweep in which every answer has to be a refusal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from bench.stability.catalogue import Refused, Worst, refused


def refused_throughout(works: Mapping[str, Callable[[], Any]], *words: str) -> Refused | Worst:
    """`refused` for each of `works` (place in the sweep → what is to refuse); the first that is answered, if any."""
    for place, work in works.items():
        found = refused(work, *words)
        if isinstance(found, Worst):
            return Worst(found.value, f"{place}: {found.at}")
    return found
