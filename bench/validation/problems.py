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
    """The line, counted from 1, of every key and list item, by its place, as ("method", 1,
    "config"). `text` is valid TOML (else JSON); constructs that are not understood are left out."""
    try:
        return _Scanner(text).toml() if toml else _Scanner(text).json()
    except (IndexError, RecursionError):
        return {}


def line_of(lines: dict[Location, int], location: Location) -> int | None:
    """The line of a place, or of the nearest place around it that has one."""
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
    """A fault in a file with its remedy. A warning is about values that are possible but
    unlikely."""

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
        """Convert findings (a text, and whether it is a warning) to problems at a key."""
        return partial(Problem, self.file, line_of(self.lines, location))

    def problem(self, location: Location, text: str) -> Problem:
        """A problem at a key."""
        return self.at(location)(text, False)

    def attempt(self, location: Location, read: Callable[[], Read]) -> Found[Read | None]:
        """The result of read(); its HandbenchError becomes a problem at a key."""
        try:
            return read()
        except HandbenchError as error:
            yield self.problem(location, str(error))
            return None

    def complaints(
        self, model: type[Model], values: Any, prefix: Location = ()
    ) -> Found[Model | None]:
        """All complaints about `values`, whose place is `prefix`; returns them as a `model` if
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
    """The result of read(); its HandbenchError becomes a problem of `file`, with the line from the
    message, if it has one."""
    try:
        return read()
    except HandbenchError as error:
        text = str(error).removeprefix(f"{file}: ")
        line = re.search(r"\bline (\d+)\b(?! of its header)", text)
        yield Problem(file, int(line[1]) if line else None, text)
        return None


def warnings_at(file: Path, texts: Iterable[str]) -> Iterator[Problem]:
    """Warnings about a file without a line."""
    return (Problem(file, None, text, warning=True) for text in texts)


def findings(
    place: "Path | Place", of: str, needed: bool = True, **facts: Any
) -> Iterator[Problem]:
    """Problems that the checks of one kind find in facts, at a file, or at a key of a parsed file.
    needed: False if a run does without the thing, so that all findings are warnings."""
    problem = partial(Problem, place, None) if isinstance(place, Path) else place
    for check in CHECKS:
        if check.of == of and check.found(facts):
            yield problem(check.advice.format(**facts), not (check.fails and needed))


def parse_lines(file: Path, what: str) -> Found[ParsedFile]:
    """Parse a TOML or JSON file with the lines of its keys; a problem if it cannot be parsed."""
    toml = file.suffix.lower() != ".json"
    values = yield from attempt(file, lambda: (read_toml if toml else read_json)(file, what))
    return ParsedFile(
        file, values, {} if values is None else lines_of(file.read_text(encoding="utf-8"), toml)
    )


def parse_model(
    model: type[Model], file: Path, what: str
) -> Found[tuple[ParsedFile, Model | None]]:
    """Parse a file as a `model`, with all complaints about it; the model is None if there are
    any."""
    found = yield from parse_lines(file, what)
    return found, None if found.values is None else (
        yield from found.complaints(model, found.values)
    )


def _keys(values: Any, location: tuple[int | str, ...]) -> Location:
    """The keys of an error's location as the file has them. Pydantic adds the tags of union
    members, which are not keys."""
    keys: list[str | int] = []
    for number, part in enumerate(location):
        there = isinstance(values, dict) and part in values
        there = there or (isinstance(values, list) and isinstance(part, int) and part < len(values))
        if there or number == len(location) - 1:
            keys.append(part)
            values = values[part] if there else None
    return tuple(keys)
