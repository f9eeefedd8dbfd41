"""Problems of files, each with its line: all that a strict configuration complains of, not the first alone."""

import re
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from bench.validation.file_lines import Location, line_of, lines_of
from radar.support.config import Config, complaint, read_toml
from radar.support.errors import HandbenchError
from radar.support.files import read_json

Read = TypeVar("Read")
Model = TypeVar("Model", bound=Config)
Found = Generator["Problem", None, Read]  # problems on the way, then what was read (None: nothing could be)


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
class Sheet:
    """A TOML or JSON file: its plain values (None: it cannot be parsed), and the lines of its keys."""

    file: Path
    values: Any
    lines: dict[Location, int]

    def problem(self, location: Location, text: str, warning: bool = False) -> Problem:
        """A problem at a key."""
        return Problem(self.file, line_of(self.lines, location), text, warning)

    def attempt(self, location: Location, read: Callable[[], Read]) -> Found[Read | None]:
        """The result of read(), or its complaint, at a key."""
        try:
            return read()
        except HandbenchError as error:
            yield self.problem(location, str(error))
            return None

    def complaints(self, model: type[Model], values: Any, prefix: Location = ()) -> Found[Model | None]:
        """All complaints about `values`, which stand at `prefix`; returns them as a `model` if there are none."""
        try:
            return model.model_validate(values)
        except pydantic.ValidationError as error:
            for problem in error.errors():
                yield self.problem((*prefix, *_keys(values, problem["loc"])), complaint(model, problem, prefix))
            return None


def failure(file: Path, error: HandbenchError) -> Problem:
    """A reader's error as a problem of its file; the line is taken from the message, if it names one."""
    text = str(error).removeprefix(f"{file}: ")
    line = re.search(r"\bline (\d+)\b(?! of its header)", text)
    return Problem(file, int(line[1]) if line else None, text)


def attempt(file: Path, read: Callable[[], Read]) -> Found[Read | None]:
    """The result of read(), or its complaint about `file`."""
    try:
        return read()
    except HandbenchError as error:
        yield failure(file, error)
        return None


def sheet(file: Path, what: str) -> Found[Sheet]:
    """A TOML or JSON file, and why it cannot be parsed."""
    toml = file.suffix.lower() != ".json"
    values = yield from attempt(file, lambda: (read_toml if toml else read_json)(file, what))
    return Sheet(file, values, {} if values is None else lines_of(file.read_text(encoding="utf-8"), toml))


def parsed(model: type[Model], file: Path, what: str) -> Found[tuple[Sheet, Model | None]]:
    """A file with all that it should not hold; its content is None where there is such."""
    found = yield from sheet(file, what)
    return found, None if found.values is None else (yield from found.complaints(model, found.values))


def _keys(values: Any, location: tuple[int | str, ...]) -> Location:
    """The location's keys as the file has them: pydantic adds the tags of unions' members, which are no keys."""
    keys: list[str | int] = []
    for number, part in enumerate(location):
        there = isinstance(values, dict) and part in values
        there = there or (isinstance(values, list) and isinstance(part, int) and part < len(values))
        if there or number == len(location) - 1:
            keys.append(part)
            values = values[part] if there else None
    return tuple(keys)
