"""Problems of files, each with its line: what `checks.CHECKS` finds, and all that a strict
configuration complains of, not the first alone; and the line numbers of the keys of TOML and JSON,
which their parsers do not tell."""

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
    """The line, counted from 1, of every key and of every item of a list, by its place as
    ("method", 1, "config"). `text` is known to be good TOML (else JSON); nothing is said of what is
    not understood."""
    try:
        return _Scanner(text).toml() if toml else _Scanner(text).json()
    except (IndexError, RecursionError):
        return {}


def line_of(lines: dict[Location, int], location: Location) -> int | None:
    """The line of a place, or of the nearest one around it that has one."""
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
        """Go on to the next token that is no line's end; False at the end of the file."""
        while self.at < len(self.tokens) and self._token() == "\n":
            self.at += 1
        return self.at < len(self.tokens)


Read = TypeVar("Read")
Model = TypeVar("Model", bound=Config)
Found = Generator[
    "Problem", None, Read
]  # problems on the way, then what was read (None: nothing could be)
Place = Callable[
    [str, bool], "Problem"
]  # a text, and whether it is a warning, as a problem where it belongs


@dataclass(frozen=True)
class Problem:
    """A fault in a file with its remedy; a warning is about what is possible, but hardly meant."""

    file: Path
    line: int | None
    text: str
    warning: bool = False

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {'warning: ' if self.warning else ''}{self.text}"


@dataclass(frozen=True)
class ParsedFile:
    """A TOML or JSON file: its plain values (None: it cannot be parsed), and the lines of its
    keys."""

    file: Path
    values: Any
    lines: dict[Location, int]

    def at(self, location: Location) -> Place:
        """The place of a key: a text and whether it is a warning become a problem there."""
        return partial(Problem, self.file, line_of(self.lines, location))

    def problem(self, location: Location, text: str) -> Problem:
        """A problem at a key."""
        return self.at(location)(text, False)

    def attempt(self, location: Location, read: Callable[[], Read]) -> Found[Read | None]:
        """The result of read(), or its complaint, at a key."""
        try:
            return read()
        except HandbenchError as error:
            yield self.problem(location, str(error))
            return None

    def complaints(
        self, model: type[Model], values: Any, prefix: Location = ()
    ) -> Found[Model | None]:
        """All complaints about `values`, which stand at `prefix`; returns them as a `model` if
        there are none."""
        try:
            return model.model_validate(values)
        except pydantic.ValidationError as error:
            for problem in error.errors():
                yield self.problem(
                    (*prefix, *_keys(values, problem["loc"])), complaint(model, problem, prefix)
                )
            return None


def attempt(file: Path, read: Callable[[], Read]) -> Found[Read | None]:
    """The result of read(), or its complaint about `file`; the line is taken from the message, if
    it names one."""
    try:
        return read()
    except HandbenchError as error:
        text = str(error).removeprefix(f"{file}: ")
        line = re.search(r"\bline (\d+)\b(?! of its header)", text)
        yield Problem(file, int(line[1]) if line else None, text)
        return None


def warnings_at(file: Path, texts: Iterable[str]) -> Iterator[Problem]:
    """Warnings about a file as a whole."""
    return (Problem(file, None, text, warning=True) for text in texts)


def findings(
    place: "Path | Place", of: str, needed: bool = True, **facts: Any
) -> Iterator[Problem]:
    """Problems that the checks of a kind of thing find in its facts: at a file, or at a key of a
    sheet. needed: False where a run does without the thing, so that all of them are warnings."""
    problem = partial(Problem, place, None) if isinstance(place, Path) else place
    for check in CHECKS:
        if check.of == of and check.found(facts):
            yield problem(check.advice.format(**facts), not (check.fails and needed))


def parse_lines(file: Path, what: str) -> Found[ParsedFile]:
    """A TOML or JSON file, and why it cannot be parsed."""
    toml = file.suffix.lower() != ".json"
    values = yield from attempt(file, lambda: (read_toml if toml else read_json)(file, what))
    return ParsedFile(
        file, values, {} if values is None else lines_of(file.read_text(encoding="utf-8"), toml)
    )


def parse_model(
    model: type[Model], file: Path, what: str
) -> Found[tuple[ParsedFile, Model | None]]:
    """A file with all that it should not hold; its content is None where there is such."""
    found = yield from parse_lines(file, what)
    return found, None if found.values is None else (
        yield from found.complaints(model, found.values)
    )


def _keys(values: Any, location: tuple[int | str, ...]) -> Location:
    """The location's keys as the file has them: pydantic adds the tags of unions' members, which
    are no keys."""
    keys: list[str | int] = []
    for number, part in enumerate(location):
        there = isinstance(values, dict) and part in values
        there = there or (isinstance(values, list) and isinstance(part, int) and part < len(values))
        if there or number == len(location) - 1:
            keys.append(part)
            values = values[part] if there else None
    return tuple(keys)
