"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

Item = TypeVar("Item")
PLAIN_INTERVAL_S = 10.0


def say(text: str) -> None:
    """One line of progress on stderr (stdout is kept for results)."""
    print(text, file=sys.stderr, flush=True)


def track(items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items` while showing how far they are: a rich bar on a terminal, else a line at most every 10 s."""
    total = total if total is not None else len(items) if isinstance(items, Sized) else None
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import track as rich_track

        yield from rich_track(items, description, total=total, console=Console(stderr=True), transient=True)
        return
    last = time.monotonic()
    for done, item in enumerate(items):
        if time.monotonic() - last > PLAIN_INTERVAL_S:
            say(f"{description}: {done}" + (f"/{total}" if total else ""))
            last = time.monotonic()
        yield item
