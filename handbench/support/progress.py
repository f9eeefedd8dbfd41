"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from multiprocessing import parent_process
from typing import TypeVar

Item = TypeVar("Item")
PLAIN_INTERVAL_S = 10.0


def say(text: str) -> None:
    """Print one line of progress on stderr (stdout is reserved for results)."""
    print(text, file=sys.stderr, flush=True)


def track(items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items` one by one and show the progress on stderr.
    On a terminal this is a bar. Elsewhere it is a line at most every 10 s, with the remaining time
    if the number of items is known. description: the work, in words; total: number of items, if
    `items` has no length."""
    total = total if total is not None else len(items) if isinstance(items, Sized) else None
    # bars of several processes would draw over each other
    if sys.stderr.isatty() and parent_process() is None:
        from rich.console import Console
        from rich.progress import track as rich_track

        yield from rich_track(
            items, description, total=total, console=Console(stderr=True), transient=True
        )
        return
    start = last = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - last > PLAIN_INTERVAL_S:
            left_s = (now - start) * (total - done) / done if total and done else None
            short = left_s is not None and left_s < 120
            left = (
                ""
                if left_s is None
                else f"{left_s:.0f} s left, "
                if short
                else f"{left_s / 60:.0f} min left, "
            )
            say(f"{left}{description}: {done}" + (f"/{total}" if total else ""))
            last = now
        yield item
