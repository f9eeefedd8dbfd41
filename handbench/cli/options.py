"""Helpers of the commands: the options declared in commands.toml."""

import argparse
import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from handbench.support.errors import HandbenchError

# name → help and options, as commands.toml declares them
COMMANDS: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("commands.toml").read_text("utf-8")
)


def positive(text: str) -> int:
    """Convert an option's text to a whole number from 1 on. Raises argparse's error for any other
    text."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number ≥ 1")
    return int(text)


def names(text: str) -> tuple[str, ...]:
    """Convert an option's text, names separated by commas."""
    return tuple(map(str.strip, text.split(",")))


def numbers(text: str) -> tuple[float, ...]:
    """Convert an option's text, numbers separated by commas."""
    return tuple(map(float, text.split(",")))


def quantity(units: Mapping[str, float], text: str) -> float:
    """Convert an option's text, a number with its unit. Raises argparse's error for any other text.
    units: unit → factor."""
    match = re.fullmatch(rf"(\d*\.?\d+)\s*({'|'.join(units)})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text} is no number with its unit, {' or '.join(units)}")
    return float(match[1]) * units[match[2]]


def path(text: str, ends: Sequence[str] = ()) -> Path:
    """Convert an option's text to a path. Raises argparse's error for an empty text, which would be
    the current folder, and for a path with another suffix than `ends`, if these are given."""
    if not text:
        raise argparse.ArgumentTypeError("the path is empty")
    if ends and Path(text).suffix.lower() not in ends:
        raise argparse.ArgumentTypeError(f"{text} does not end in {' or '.join(ends)}")
    return Path(os.path.expanduser(text))


TYPES: dict[str, Callable[[str], Any]] = {
    "int": int,
    "float": float,
    "path": path,
    "positive": positive,
    "names": names,
    "numbers": numbers,
    "millimetres": partial(quantity, {"mm": 1.0}),
    "seconds": partial(quantity, {"ms": 1e-3, "s": 1.0}),
}


def add_options(command: argparse.ArgumentParser, options: Mapping[str, Mapping[str, Any]]) -> None:
    """Add declared options to the parser of a command.
    options: names, separated by commas → keywords. These are the keywords of argparse's
    `add_argument`, and besides: type, a name in TYPES; group, the heading in the help; either, a
    word shared by options of which only one may be given; ends, the allowed suffixes of a path."""
    group = cache(command.add_argument_group)
    either = cache(lambda _: command.add_mutually_exclusive_group())
    for names, keywords in options.items():
        facts = dict(keywords)
        if "type" in facts:
            facts["type"] = TYPES[facts["type"]]
        if "ends" in facts:
            facts["type"] = partial(path, ends=facts.pop("ends"))
        place: Any = command
        if "group" in facts:
            place = group(facts.pop("group"))
        if "either" in facts:
            place = either(facts.pop("either"))
        place.add_argument(*names.split(", "), **facts)


def set_values(values: dict[str, Any], settings: Sequence[str], example: str) -> None:
    """Set values by the texts KEY=VALUE of the option --set, in the dictionary `values`.
    A dot in a key leads into a table. example: a correct KEY=VALUE, for messages. Raises
    HandbenchError for any other text."""
    for setting in settings:
        key, separator, text = setting.partition("=")
        *parents, leaf = key.split(".")
        place: Any = values
        for parent in parents:
            place = place.setdefault(parent, {}) if isinstance(place, dict) else None
        if not separator or not isinstance(place, dict):
            raise HandbenchError(f"--set: is '{setting}'; expected KEY=VALUE, such as {example}")
        try:
            place[leaf] = tomllib.loads(f"value = {text}")["value"]
        except ValueError:  # no TOML, or a number that is too long
            place[leaf] = text
