"""Problems of files, each with its line: findings of `checks.CHECKS`, and all complaints of a
strict configuration, not only the first; and line numbers of the keys of TOML and JSON, which their
parsers do not report."""

import re
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from handbench.bench.validation.checks import CHECKS
from handbench.support.config import Config, complaint, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

Location = tuple[str | int, ...]
TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}'''  # strings of several lines
    r"""|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*"""  # strings, comments
    r"""|[\[\]{}=:,.\n]|[^\s\[\]{}=:,."'\#]+""",  # punctuation, words
    re.DOTALL,
)


def lines_of(text: str, toml: bool = True) -> dict[Location, int]:
    """Find the line, counted from 1, of every key and list item of a text: place → line, with
    places as ("method", 1, "config").
    toml: the text is TOML, else JSON; it must be valid. What is not understood is left out."""
    try:
        return _Scanner(text).toml() if toml else _Scanner(text).json()
    except (IndexError, RecursionError):
        return {}


def line_of(lines: dict[Location, int], location: Location) -> int | None:
    """Return the line of a place, or of the nearest place around it that has one; None if there is
    none."""
    return next(
        (lines[location[:n]] for n in range(len(location), -1, -1) if location[:n] in lines), None
    )


class _Scanner:
    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, int]] = []
        self.at = 0
        self.lines: dict[Location, int] = {}
        line, end = 1, 0
        for match in TOKEN.finditer(text):
            line += text.count("\n", end, match.start())
            end = match.start()
            if not match.group().startswith("#"):
                self.tokens.append((match.group(), line))
        self.tokens.append(("\n", line))

    def json(self) -> dict[Location, int]:
        self._value(())
        return self.lines

    def toml(self) -> dict[Location, int]:
        table: Location = ()
        counts: dict[Location, int] = {}  # of [[tables]]
        while self._skip_newlines():
            line = self.tokens[self.at][1]
            if self._token() != "[":
                self._pair(table)
                continue
            several = self.tokens[self.at + 1][0] == "["
            self.at += 2 if several else 1
            table = ()
            keys = self._key("]")
            for key in keys[:-1]:
                table = (*table, key)
                table += (counts[table] - 1,) if table in counts else ()
            table = (*table, keys[-1])
            if several:
                self.lines.setdefault(table, line)
                counts[table] = counts.get(table, 0) + 1
                table = (*table, counts[table] - 1)
            self.lines.setdefault(table, line)
            self.at += 2 if several else 1
        return self.lines

    def _pair(self, table: Location) -> None:
        line = self.tokens[self.at][1]
        place = table
        for key in self._key("=", ":"):
            place = (*place, key)
            self.lines.setdefault(place, line)
        self.at += 1
        self._value(place)

    def _key(self, *ends: str) -> list[str]:
        parts = []
        while self._token() not in ends:
            token = self._token()
            if token != ".":
                parts.append(token[1:-1] if token[0] in "\"'" else token)
            self.at += 1
        return parts

    def _value(self, place: Location) -> None:
        opened = self._token()
        if opened not in ("[", "{"):
            while self._token() not in (",", "]", "}", "\n"):
                self.at += 1
            return
        self.at += 1
        index = 0
        while self._skip_newlines() and self._token() not in ("]", "}"):
            if self._token() == ",":
                self.at += 1
            elif opened == "{":
                self._pair(place)
            else:
                self.lines[(*place, index)] = self.tokens[self.at][1]
                self._value((*place, index))
                index += 1
        self.at += 1

    def _token(self) -> str:
        return self.tokens[self.at][0]

    def _skip_newlines(self) -> bool:
        """Skip to the next token that is not a line end; False at the end of the file."""
        while self.at < len(self.tokens) and self._token() == "\n":
            self.at += 1
        return self.at < len(self.tokens)


Read = TypeVar("Read")
Model = TypeVar("Model", bound=Config)
# problems on the way, then what was read (None: nothing could be)
Found = Generator["Problem", None, Read]
# a text, and whether it is a warning, as a problem where it belongs
Place = Callable[[str, bool], "Problem"]


@dataclass(frozen=True)
class Problem:
    """A fault in a file with its remedy.
    line: None if unknown, or not of a line. warning: the values are possible, but unlikely."""

    file: Path
    line: int | None
    text: str
    warning: bool = False

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {'warning: ' if self.warning else ''}{self.text}"


@dataclass(frozen=True)
class ParsedFile:
    """A TOML or JSON file that was read: its plain values (None: it cannot be parsed), and the
    lines of its keys."""

    file: Path
    values: Any
    lines: dict[Location, int]

    def at(self, location: Location) -> Place:
        """Return a function that makes problems at a key. It takes a text, and whether it is a
        warning."""
        return partial(Problem, self.file, line_of(self.lines, location))

    def problem(self, location: Location, text: str) -> Problem:
        """Make a problem at a key, with its line."""
        return self.at(location)(text, False)

    def attempt(self, location: Location, read: Callable[[], Read]) -> Found[Read | None]:
        """Call `read` and return its result. If it raises a HandbenchError, yield this as a problem
        at a key, and return None."""
        try:
            return read()
        except HandbenchError as error:
            yield self.problem(location, str(error))
            return None

    def complaints(
        self, model: type[Model], values: Any, prefix: Location = ()
    ) -> Found[Model | None]:
        """Convert values to a `model`, a strict configuration, and return it. If they do not fit,
        yield a problem for every complaint, and return None.
        prefix: the place of the values in the file."""
        try:
            return model.model_validate(values)
        except pydantic.ValidationError as error:
            for problem in error.errors():
                yield self.problem(
                    (*prefix, *_keys(values, problem["loc"])), complaint(model, problem, prefix)
                )
            return None


def attempt(file: Path, read: Callable[[], Read]) -> Found[Read | None]:
    """Call `read` and return its result. If it raises a HandbenchError, yield this as a problem of
    `file`, with the line that the message names, and return None."""
    try:
        return read()
    except HandbenchError as error:
        text = str(error).removeprefix(f"{file}: ")
        line = re.search(r"\bline (\d+)\b(?! of its header)", text)
        yield Problem(file, int(line[1]) if line else None, text)
        return None


def warnings_at(file: Path, texts: Iterable[str]) -> Iterator[Problem]:
    """Make a warning about a file, without a line, of each text."""
    return (Problem(file, None, text, warning=True) for text in texts)


def findings(
    place: "Path | Place", of: str, needed: bool = True, **facts: Any
) -> Iterator[Problem]:
    """Yield the problems that the checks of one kind find.
    place: a file, or what ParsedFile.at returns for a key. of: the kind of thing, as in CHECKS.
    needed: False if a run does without the thing, so that all findings are warnings. facts: the
    values that the checks look at, by name."""
    problem = partial(Problem, place, None) if isinstance(place, Path) else place
    for check in CHECKS:
        if check.of == of and check.found(facts):
            yield problem(check.advice.format(**facts), not (check.fails and needed))


def parse_lines(file: Path, what: str) -> Found[ParsedFile]:
    """Read a TOML or JSON file with the lines of its keys, and return it. If it cannot be parsed,
    yield the problem. what: for the message, what the file is."""
    toml = file.suffix.lower() != ".json"
    values = yield from attempt(file, lambda: (read_toml if toml else read_json)(file, what))
    return ParsedFile(
        file, values, {} if values is None else lines_of(file.read_text(encoding="utf-8"), toml)
    )


def parse_model(
    model: type[Model], file: Path, what: str
) -> Found[tuple[ParsedFile, Model | None]]:
    """Read a file as a `model`, a strict configuration; return the parsed file and the model.
    Yields all complaints; if there are any, the model is None."""
    found = yield from parse_lines(file, what)
    return found, None if found.values is None else (
        yield from found.complaints(model, found.values)
    )


def _keys(values: Any, location: tuple[int | str, ...]) -> Location:
    """Return an error's place as keys of the file: without the tags that pydantic adds for members
    of a union."""
    keys: list[str | int] = []
    for number, part in enumerate(location):
        there = isinstance(values, dict) and part in values
        there = there or (isinstance(values, list) and isinstance(part, int) and part < len(values))
        if there or number == len(location) - 1:
            keys.append(part)
            values = values[part] if there else None
    return tuple(keys)
