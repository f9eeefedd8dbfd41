"""What a command prints: its progress on stderr, one line, drawn again and again on a terminal and
printed every 10 s elsewhere, if it changed; and long lines of its output, broken between words."""

import json
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import parent_process
from operator import length_hint
from typing import Any, TypeVar

from handbench.support.errors import printable

Item = TypeVar("Item")
LIVE_INTERVAL_S = 0.25
PLAIN_INTERVAL_S = 10.0
ERASE_LINE = "\r\x1b[2K"


def say(text: str) -> None:
    """Print one line of progress on stderr (stdout is reserved for results).
    On a terminal it takes the line of the progress, which is drawn again below, so that further
    processes can print too. Nothing is printed where stderr is closed or full."""
    erase = ERASE_LINE if is_terminal(sys.stderr) else ""
    _write(f"{erase}{printable(text)}\n")


def warn(where: object, warnings: Iterable[str]) -> None:
    """Print warnings of a file or folder on stderr."""
    for warning in warnings:
        say(f"{where}: {warning}")


def _write(text: str) -> None:
    with suppress(AttributeError, OSError, ValueError):
        sys.stderr.write(text)
        sys.stderr.flush()


def is_terminal(stream: Any) -> bool:
    """Tell whether a stream is a terminal; False for one that is closed, or that can only write."""
    with suppress(AttributeError, ValueError):
        return stream.isatty()
    return False


def print_lines(*lines: str) -> None:
    """Print lines on stdout, each on one line whatever characters it has."""
    print(*map(printable, lines), sep="\n")


def print_json(content: Any) -> None:
    """Print JSON on stdout, in UTF-8; only characters that cannot be printed are escaped."""
    text = json.dumps(content, indent=2, ensure_ascii=False)
    print("".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text))


def print_wrapped(text: str, indent: str) -> None:
    """Print a text on stdout, broken between words to the width of the terminal (80 without one).
    indent: begins all lines but the first."""
    width = shutil.get_terminal_size().columns
    lines = textwrap.fill(
        printable(text),
        width,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    print(lines)


def duration(seconds: float) -> str:
    """Return a time in words, in seconds, minutes or hours."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6e3 else f"{seconds / 3600:.3g} h"


@dataclass
class Work:
    """Counted parts of a command's work.
    total: number of parts (0: unknown); done: how many have ended; running: labels of those that
    have begun; abreast: how many of these are at work at a time, the others wait; detail: the step
    of a part that is at work now; start: time.monotonic() at the beginning."""

    total: int
    done: int = 0
    running: list[str] = field(default_factory=list)
    abreast: int | None = None
    detail: str = ""
    start: float = field(default_factory=time.monotonic)

    @contextmanager
    def part(self, label: str) -> Iterator[None]:
        """Context manager of one part; the number of parts done rises when it ends."""
        self.begin(label)
        try:
            yield
        finally:
            self.end(label)

    def begin(self, label: str) -> None:
        """Show a part as begun."""
        self.running.append(label)

    def end(self, label: str) -> None:
        """Count a part as done."""
        self.running.remove(label)
        self.detail, self.done = "", self.done + 1

    def reach(self, done: int) -> None:
        """Count further parts as done, up to `done` in all, because they are not needed."""
        self.done = max(self.done, done)

    def line(self) -> str:
        """Return how many parts are done, of how many; the time since the start; and the parts at
        work, if there are any, with the current step. It has at most 80 characters."""
        count = f"{min(self.done, self.total)} of {self.total}" if self.total else f"{self.done}"
        text = f"{count} done, {duration(time.monotonic() - self.start)} so far"
        at_work = ", ".join(filter(None, (*self.running[: self.abreast], self.detail)))
        return textwrap.shorten(f"{text}; now {at_work}" if at_work else text, 80, placeholder=" …")


_current: Work | None = None


@contextmanager
def counted(total: int) -> Iterator[Work]:
    """Context manager that shows the progress of work in `total` parts while its block runs.
    Nothing is shown inside other work, or in a process that this program started."""
    global _current
    work = Work(total)
    if _current is not None or parent_process() is not None:
        yield work
        return
    _current, ended = work, threading.Event()
    printer = threading.Thread(target=_show, args=(work, ended), daemon=True)
    printer.start()
    try:
        yield work
    finally:
        _current = None
        ended.set()
        printer.join()


def _show(work: Work, ended: threading.Event) -> None:
    """Show the line of progress until the work has ended: on a terminal drawn again and again,
    elsewhere printed every 10 s (PLAIN_INTERVAL_S), if it says something new."""
    live, shown = is_terminal(sys.stderr), ""
    while not ended.wait(LIVE_INTERVAL_S if live else PLAIN_INTERVAL_S):
        line = printable(work.line())
        if live:
            from rich.cells import set_cell_size

            width = shutil.get_terminal_size().columns - 1
            _write(ERASE_LINE + set_cell_size(line, width).rstrip())
        elif line != shown:
            say(line)
        shown = line
    if live:
        _write(ERASE_LINE)


def track(items: Iterable[Item], description: str, total: int = 0) -> Iterator[Item]:
    """Yield `items` one by one and show the progress on stderr; inside other work, as a step of the
    part at work.
    description: the work, in words; total: number of items, if `items` has no length."""
    total = total or length_hint(items)
    if (outer := _current) is not None:
        for number, item in enumerate(items):
            outer.detail = f"{description} {number + 1}" + (f" of {total}" if total else "")
            yield item
        return
    with counted(total) as work:
        work.begin(description)
        for item in items:
            yield item
            work.done += 1
