"""Problems and warnings of the inputs of `handbench inspect`, one line each."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from handbench.bench.validation.checks import warnings_of
from handbench.support.errors import HandbenchError, printable

Read = TypeVar("Read")


class Report:
    """The problems and warnings of an input. lines: text → whether it is only a warning, in the
    order in which they were found. notes: what the input can show, which is no mistake."""

    def __init__(self) -> None:
        self.lines: dict[str, bool] = {}
        self.notes: list[str] = []

    def read(self, place: Path | str, reader: Callable[[], Read]) -> Read | None:
        """Call `reader` and return its result. If it raises a HandbenchError, add all problems in
        it, and return None. place: the file or folder that is read."""
        try:
            return reader()
        except HandbenchError as error:
            self.refuse(place, *error.problems)
            return None

    def refuse(self, place: Path | str, *problems: str) -> None:
        """Add problems of a file or folder, with which a run would fail."""
        for text in problems:
            named = text.startswith((f"{printable(str(place))}: ", f"{place}/"))
            self.lines[text if named else f"{place}: {text}"] = False

    def warn(self, place: Path, warnings: Iterable[str]) -> None:
        """Add warnings about a file or folder."""
        for text in warnings:
            self.lines[f"{place}: warning: {text}"] = True

    def check(
        self, place: Path, thing: Read | None, checks: Sequence[Callable[[Read], Iterator[str]]]
    ) -> None:
        """Add the warnings of checks of a thing that was read from a file or folder (None: it could
        not be read)."""
        if thing is not None:
            self.warn(place, warnings_of(thing, checks))
