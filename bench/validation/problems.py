"""Problems of input files, each with its line.

They come from the checks in `checks.CHECKS`, and from the validation of configurations, of which
all errors are reported, not only the first. The line numbers of keys are found here, since the
parsers of TOML and JSON do not report them.
"""

import ast
import re
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from handbench.bench.validation.checks import CHECKS
from handbench.support.config import Config, Location, complaints, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

NAME = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""  # of a key of TOML
# characters of a JSON text whose lines are found: its tree takes 400 times as much memory
LONGEST = 1 << 20
KEYS = rf"({NAME}(?:\s*\.\s*{NAME})*)\s*"
TOML_LINE = re.compile(rf"\s*(?:(\[\[?)\s*{KEYS}\]\]?\s*(?:#|$)|{KEYS}=)")  # [table] or key =


def lines_of(text: str, toml: bool = True) -> dict[Location, int]:
    """Find the lines, counted from 1, of the keys of a text: a dictionary place → line, with places
    such as ("method", 1, "config").

    toml: True if the text is TOML, False if it is JSON; it must be valid. In TOML, tables and keys
    that begin a line are found, and in JSON all keys and list items.
    """
    if not toml:
        if len(text) > LONGEST:
            return {}
        # the one escape that Python lacks
        python = re.sub(r"(\\\\)|\\/", lambda found: found[1] or "/", text.lstrip("\ufeff"))
        try:
            return dict(_json_lines(ast.parse(f"({python}\n)", mode="eval").body, ()))
        except (SyntaxError, ValueError, RecursionError, MemoryError):  # nested too deeply
            return {}
    lines: dict[Location, int] = {}
    table: Location = ()
    counts = Counter[Location]()  # of [[tables]]
    for number, line in enumerate(text.split("\n"), 1):
        if found := TOML_LINE.match(line):
            opened, header, key = found.groups()
            place = () if header else table
            names = re.findall(NAME, header or key)
            for i, name in enumerate(names, 1):
                place = (*place, name.strip("\"'"))
                counts[place] += opened == "[[" and i == len(names)
                if header and counts[place]:
                    lines.setdefault(place, number)  # of the list as a whole
                    place = (*place, counts[place] - 1)
            table = place if header else table
            lines.setdefault(place, number)
    return lines


def _json_lines(node: ast.expr, place: Location) -> Iterator[tuple[Location, int]]:
    """Yield the places and lines of a JSON value, parsed as Python, at `place` and in it."""
    yield place, node.lineno
    if isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            yield from _json_lines(value, (*place, getattr(key, "value", "")))
    if isinstance(node, ast.List):
        for index, value in enumerate(node.elts):
            yield from _json_lines(value, (*place, index))


def line_of(lines: dict[Location, int], location: Location) -> int | None:
    """Return the line of a place in a file, or of the nearest place around it that has one; None if
    there is none. lines: from `lines_of`."""
    return next(
        (lines[location[:n]] for n in range(len(location), -1, -1) if location[:n] in lines), None
    )


Read = TypeVar("Read")
Model = TypeVar("Model", bound=Config)
# problems on the way, then what was read (None: nothing could be)
Found = Generator["Problem", None, Read]
# a text, and whether it is a warning, as a problem where it belongs
Place = Callable[[str, bool], "Problem"]


@dataclass(frozen=True)
class Problem:
    """A fault in a file, with its remedy in the text.

    line: None if it is unknown, or if the fault is not in one line. warning: True if the values are
    possible, but unlikely.
    """

    file: Path
    line: int | None
    text: str
    warning: bool = False

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {'warning: ' if self.warning else ''}{self.text}"


@dataclass(frozen=True)
class ParsedFile:
    """A TOML or JSON file that was read. values: its content as plain values (None: it cannot be
    parsed); lines: the lines of its keys."""

    file: Path
    values: Any
    lines: dict[Location, int]

    def at(self, location: Location) -> Place:
        """Return a function (text, whether it is a warning) → `Problem` at the line of a key."""
        return partial(Problem, self.file, line_of(self.lines, location))

    def problem(self, location: Location, text: str) -> Problem:
        """Return a problem at the line of a key."""
        return self.at(location)(text, False)

    def attempt(self, location: Location, read: Callable[[], Read]) -> Found[Read | None]:
        """Call `read` and return its result. If it raises a HandbenchError, yield that as a problem
        at the line of the key `location`, and return None."""
        try:
            return read()
        except HandbenchError as error:
            yield self.problem(location, str(error))
            return None

    def complaints(
        self, model: type[Model], values: Any, prefix: Location = ()
    ) -> Found[Model | None]:
        """Convert values to an instance of `model`, a configuration class, and return it. If they
        are invalid, yield a problem for every error, and return None.

        prefix: the place of the values in the file.
        """
        try:
            return model.model_validate(values)
        except pydantic.ValidationError as error:
            for place, text in complaints(error, values, prefix):
                yield self.problem(place, text)
            return None


def attempt(file: Path, read: Callable[[], Read]) -> Found[Read | None]:
    """Call `read` and return its result. If it raises a HandbenchError, yield that as a problem of
    `file`, with the line that the message names, if it names one, and return None."""
    try:
        return read()
    except HandbenchError as error:
        text = str(error).removeprefix(f"{file}: ")
        line = re.search(r"\bline (\d+)\b(?! of its header)", text)
        yield Problem(file, int(line[1]) if line else None, text)
        return None


def warnings_at(file: Path, texts: Iterable[str]) -> Iterator[Problem]:
    """Convert each text to a warning about a file, without a line."""
    return (Problem(file, None, text, warning=True) for text in texts)


def findings(
    place: "Path | Place", of: str, needed: bool = True, **facts: Any
) -> Iterator[Problem]:
    """Yield the problems that the checks of one kind of thing find.

    place: a file, or for a key the result of `ParsedFile.at`. of: the kind, as in `Check.of`.
    needed: False if a run does not need the thing, so that all findings are only warnings. facts:
    the values that the checks use, by name.
    """
    problem = partial(Problem, place, None) if isinstance(place, Path) else place
    for check in CHECKS:
        if check.of == of and check.found(facts):
            yield problem(check.advice.format(**facts), not (check.fails and needed))


def parse_lines(file: Path, what: str) -> Found[ParsedFile]:
    """Read a TOML or JSON file and find the lines of its keys: a `ParsedFile`. If it cannot be
    parsed, yield the problem; the values are then None. what: name of the kind of file, for the
    message."""
    toml = file.suffix.lower() != ".json"
    values = yield from attempt(file, lambda: (read_toml if toml else read_json)(file, what))
    return ParsedFile(
        file, values, {} if values is None else lines_of(file.read_text(encoding="utf-8"), toml)
    )


def parse_model(
    model: type[Model], file: Path, what: str
) -> Found[tuple[ParsedFile, Model | None]]:
    """Read a file as an instance of `model`, a configuration class: (parsed file, instance). Yields
    all errors in the file; if there are any, the instance is None. what: name of the kind of file,
    for the message."""
    found = yield from parse_lines(file, what)
    return found, None if found.values is None else (
        yield from found.complaints(model, found.values)
    )
