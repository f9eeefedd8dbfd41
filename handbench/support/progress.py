"""Progress of a command on stderr: one bar on a terminal, a line every 10 s elsewhere."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from multiprocessing import parent_process
from typing import TYPE_CHECKING, TypeVar

from handbench.support.parallel import workers

if TYPE_CHECKING:
    from rich.table import Table

Item = TypeVar("Item")
PLAIN_INTERVAL_S = 10.0
TRUSTED_S = 10.0  # after this time, the measured rate of work counts as much as the predicted one
MOST = 0.95  # of a part that has not ended, however long it takes
ERASE_LINE = "\r\x1b[2K"


def say(text: str) -> None:
    """Print one line of progress on stderr (stdout is reserved for results).
    On a terminal it takes the line of the bar, which is drawn again below, so that further
    processes can print too."""
    erase = ERASE_LINE if sys.stderr.isatty() else ""
    sys.stderr.write(f"{erase}{text}\n")
    sys.stderr.flush()


def duration(seconds: float) -> str:
    """Return a time in words, in seconds, minutes or hours."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6e3 else f"{seconds / 3600:.3g} h"


@dataclass
class Work:
    """Work that a bar shows, in any unit, such as predicted seconds of one core.
    total: all of it (None: unknown); rate: expected work per second (None: unknown until some is
    done); start: time.monotonic() at the beginning. done: work of the parts that have ended;
    done_at: when the last one ended. running: label → work of each part that has begun. inside:
    parts that begin now are steps of those; detail: the current step."""

    total: float | None
    rate: float | None
    start: float
    done: float = 0.0
    done_at: float = field(init=False)
    running: dict[str, float] = field(default_factory=dict)
    inside: bool = False
    detail: str = ""

    def __post_init__(self) -> None:
        self.done_at = self.start

    def begin(self, label: str, size: float) -> None:
        """Begin a part with the given work, or a step of a part."""
        if self.inside:
            self.detail = label
        else:
            self.running[label] = size

    def end(self, label: str, now: float, skipped: bool = False) -> None:
        """End a part. skipped: it was done already, so it is no part of this work."""
        size, self.detail = self.running.pop(label, 0.0), ""
        if skipped and self.total is not None:
            self.total -= size
        elif not skipped:
            self.done, self.done_at = self.done + size, now

    def _at(self, now: float) -> tuple[float, float | None]:
        """Return the work done until now, with that of running parts by the rate; and the rate."""
        weight_s = TRUSTED_S if self.rate is not None else 0.0
        seconds = self.done_at - self.start + weight_s
        rate = (self.done + weight_s * (self.rate or 0.0)) / seconds if seconds > 0 else 0.0
        under_way = min(rate * (now - self.done_at), MOST * sum(list(self.running.values())))
        return self.done + under_way, rate or None

    def share(self, now: float) -> float | None:
        """Return the share of the work that is done, 0 to 1; None if the total is unknown."""
        return min(self._at(now)[0] / self.total, 1.0) if self.total else None

    def left(self, now: float) -> str:
        """Return the time left in words, "" if it is unknown."""
        done, rate = self._at(now)
        return f"{duration((self.total - done) / rate)} left" if self.total and rate else ""

    def label(self) -> str:
        """Return the running parts and their current step."""
        names = list(self.running)
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        return ", ".join(filter(None, (f"{names[0]}{others}" if names else "", self.detail)))

    def line(self, now: float) -> str:
        """Return share, time left and running parts as one line."""
        share = self.share(now)
        known = [f"{100 * share:.0f} %" if share is not None else "", self.left(now)]
        return ": ".join(filter(None, (", ".join(filter(None, known)), self.label())))

    def bar(self) -> "Table":
        """Return the same as a bar for a terminal, one line high."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        now = time.monotonic()
        share = self.share(now)
        line = Table.grid(padding=(0, 1))
        for _ in range(4):
            line.add_column(no_wrap=True, overflow="ellipsis")
        drawn = ProgressBar(1.0, share or 0.0, width=24, pulse=share is None)
        line.add_row(
            drawn,
            "" if share is None else f"{100 * share:.0f} %",
            self.left(now),
            self.label() or "…",
        )
        return line


_current: Work | None = None


@contextmanager
def work(total: float | None, rate: float | None = None) -> Iterator[None]:
    """Context manager that shows the progress of the work in its block; `begin` and `end`, or
    `part`, tell which parts are done.
    total: all of the work (None: unknown); rate: work per second that is expected. Nothing is
    shown inside other work, of which this is a part then, or in a process that this program
    started."""
    global _current
    if _current is not None or parent_process() is not None:
        yield
        return
    _current = Work(total, rate, time.monotonic())
    try:
        with _shown(_current):
            yield
    finally:
        _current = None


def predicted_work(core_s: float) -> AbstractContextManager[None]:
    """Return `work` of a predicted processor time, s, which all cores share."""
    return work(core_s, float(workers()))


@contextmanager
def _shown(of: Work) -> Iterator[None]:
    """Show work while the block runs, by a thread that only reads it."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.live import Live

        with Live(
            get_renderable=of.bar,
            console=Console(stderr=True),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        ):
            yield
        return
    ended = threading.Event()

    def print_lines() -> None:
        while not ended.wait(PLAIN_INTERVAL_S):
            say(of.line(time.monotonic()))

    printer = threading.Thread(target=print_lines, daemon=True)
    printer.start()
    try:
        yield
    finally:
        ended.set()
        printer.join()


def begin(label: str, size: float = 1.0) -> None:
    """Begin a part of the current work, if there is any. label: its name; size: its work."""
    if _current is not None:
        _current.begin(label, size)


def end(label: str, skipped: bool = False) -> None:
    """End a part of the current work. skipped: it was done already by an earlier command."""
    if _current is not None:
        _current.end(label, time.monotonic(), skipped)


@contextmanager
def part(label: str, size: float = 1.0) -> Iterator[None]:
    """Context manager of one part of the current work; inside another part it is a step of it.
    label: its name; size: its work."""
    if (of := _current) is None:
        yield
        return
    before = of.inside
    of.inside = before or bool(of.running)
    of.begin(label, size)
    of.inside = True
    try:
        yield
    finally:
        of.inside = before
        of.end(label, time.monotonic())


def track(items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
    """Yield `items` one by one and show the progress on stderr; inside other work, as its step.
    description: the work, in words; total: number of items, if `items` has no length."""
    total = total if total is not None else len(items) if isinstance(items, Sized) else None
    alone = nullcontext() if _current is not None else work(total)
    with alone:
        for number, item in enumerate(items):
            with part(f"{description} {number + 1}" + (f" of {total}" if total else "")):
                yield item
