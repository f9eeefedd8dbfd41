"""Configurations that are checked strictly: every key must be known and every value valid. For a
mistyped key, the nearest known one is suggested."""

import json
import re
import reprlib
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from difflib import SequenceMatcher
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import pydantic
from pydantic_core import PydanticCustomError

from handbench.support.errors import HandbenchError
from handbench.support.files import (
    LONG_KEY,
    NAME_BYTES,
    TOML_BYTES,
    one_form,
    read_parsed,
    require_shallow,
)

ConfigT = TypeVar("ConfigT", bound="Config")
GIGA = 1e9
SMALLEST = 1e-30  # of a number's size
LARGEST = 1e30
MOST_PROBLEMS = 1000  # of one table
SHOWN = 4  # of them in one message
VALUE = reprlib.Repr()  # as a message quotes it, not a whole table
VALUE.maxlevel, VALUE.maxdict, VALUE.maxlist, VALUE.maxtuple = 2, 3, 3, 3
WORDS = {  # pydantic's, as regular expressions, and ours
    r"^\w+ should (be|have) ": "expected ",
    r"expected (?=(greater|less) than)": "expected a number ",
    r"a valid dictionary.*": "a table of keys",
    r"a valid (list|tuple)": "a list",
    r"a valid string": "a text",
    r"a valid integer.*": "a whole number",
    r"a valid number.*": "a number",
    r"a valid boolean.*": "true or false",
    r"^Value error, | after validation": "",
}


class Config(pydantic.BaseModel):
    """Base class of every configuration. Its values cannot be changed.
    Errors are: an unknown key at any level, a text or a truth value in place of a number and the
    other way round, NaN or infinity, and a number so large or small that no quantity in SI units
    has this size. Default values are checked too."""

    model_config = pydantic.ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True
    )

    @pydantic.model_validator(mode="wrap")
    @classmethod
    def _note_keys(cls, values: Any, validate: pydantic.ModelWrapValidatorHandler[Self]) -> Self:
        """Refuse values that became numbers or truth values on the way, and note the known keys in
        the error of an unknown one, for the message."""
        try:
            checked = validate(values)
        except pydantic.ValidationError as error:
            known = {"known": [key.alias or name for name, key in cls.model_fields.items()]}
            noted: list[Any] = [
                {
                    **each,
                    "type": PydanticCustomError(each["type"], each["msg"], each.get("ctx", known)),
                }
                for each in error.errors(include_url=False)[:MOST_PROBLEMS]
            ]
            raise pydantic.ValidationError.from_exception_data(cls.__name__, noted) from None
        for name, given in values.items() if isinstance(values, dict) else ():
            if name in cls.model_fields and not _as_given(given, getattr(checked, name)):
                raise ValueError(
                    f"'{name}' is {VALUE.repr(given)}; expected a number without quotation marks "
                    "where a number is due, and true or false elsewhere"
                )
        return checked

    @pydantic.field_validator("*")
    @classmethod
    def _in_range(cls, value: Any) -> Any:
        """Refuse numbers so small or so large that they would vanish or overflow in float32.
        Numbers in a tuple, such as coordinates, may be that small, because rounding can cause
        it."""
        vanishes = isinstance(value, float) and 0 < abs(value) < SMALLEST
        if vanishes or max(map(abs, _numbers(value)), default=0) > LARGEST:
            raise ValueError(f"expected 0 or a size from {SMALLEST:g} to {LARGEST:g}")
        return value


def _as_given(given: object, value: object) -> bool:
    """Tell whether the numbers and truth values in a checked value were these before."""
    if isinstance(given, dict) and isinstance(value, dict):
        return all(map(_as_given, given.values(), value.values()))
    if isinstance(given, tuple | list) and isinstance(value, tuple | list):
        return all(map(_as_given, given, value))
    if isinstance(value, bool) or isinstance(given, bool):
        return given is value
    return not (isinstance(value, int | float) and isinstance(given, str))


def _numbers(value: object) -> Iterator[int | float]:
    """Yield a number, or every number in a tuple, list or table."""
    if isinstance(value, int | float):
        yield value
    elif isinstance(value, tuple | list | dict):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _numbers(part)


def parse(model: type[ConfigT], values: dict[str, Any], where: str) -> ConfigT:
    """Return a configuration of the class `model` from plain values, such as those of a TOML file.
    where: a file or an option, with which the message begins. Raises HandbenchError, whose
    `problems` are all wrong values; its message names the first four (SHOWN)."""
    try:
        return model.model_validate(values)
    except pydantic.ValidationError as error:
        problems = [
            (_place(problem, values), problem) for problem in error.errors(include_url=False)
        ]
        # where an item is wrong, its list is too short, or another kind of value is expected
        outer = {place[:n] for place, _ in problems for n in range(len(place))}
        named = (_text(place, problem) for place, problem in problems if place not in outer)
        texts = [*dict.fromkeys(named)]
        others = [f"and {len(texts) - SHOWN} more"] if len(texts) > SHOWN else []
        raise HandbenchError(
            f"{where}: {'; '.join(texts[:SHOWN] + others)}", [f"{where}: {text}" for text in texts]
        ) from None


def _text(place: tuple[int | str, ...], problem: Any) -> str:
    """Say in words what is wrong with the value at a place. problem: one of pydantic's errors."""
    key, kind = ".".join(map(str, place)), problem["type"]
    message = problem["msg"]
    for pattern, words in WORDS.items():
        message = re.sub(pattern, words, message)
    if message[1:2].islower():  # no name such as R
        message = message[0].lower() + message[1:]
    if kind in ("missing", "union_tag_not_found"):
        return f"key '{key}' is missing; add it"
    if kind == "extra_forbidden":
        return f"unknown key '{key}'; {suggest(str(place[-1]), problem['ctx']['known'])}"
    if kind == "union_tag_invalid":
        return f"'{key}' is '{problem['ctx']['tag']}'; expected {problem['ctx']['expected_tags']}"
    if kind == "value_error" and isinstance(problem["input"], dict):
        return f"'{key}': {message}" if key else message
    subject = f"'{key}'" if key else "the content"
    return f"{subject} is {VALUE.repr(problem['input'])}; {message}"


def _place(problem: Any, values: Any) -> tuple[int | str, ...]:
    """Return the keys of the file that lead to a wrong value. pydantic's place of it also names the
    chosen alternatives of unions."""
    keys: list[int | str] = []
    for part in problem["loc"]:
        with suppress(LookupError, TypeError):
            values = values[part]
            keys.append(part)
    if problem["type"] == "missing":
        keys.append(problem["loc"][-1])
    if problem["type"].startswith("union_tag"):
        keys.append(problem["ctx"]["discriminator"].strip("'"))
    return tuple(keys)


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Return the content of a TOML file as plain values.
    what: the expected content, in words, for messages. Raises HandbenchError for a missing or
    broken file."""
    return read_parsed(path, what, "TOML", plain_toml, TOML_BYTES)


def plain_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML text as plain values. Raises ValueError for text that is invalid
    or too deeply nested (for some deep nesting RecursionError)."""
    if LONG_KEY.search(text):
        raise ValueError("a key has too many parts (32 or more, separated by points)")
    return require_shallow(tomllib.loads(text))


def inline_toml(value: Any) -> str:
    """Write a value as TOML does in one line, with frequencies as 82e9."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {inline_toml(each)}' for key, each in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(inline_toml, value))}]"
    if isinstance(value, float) and value >= GIGA and float(f"{value / GIGA}e9") == value:
        return f"{value / GIGA:.12g}e9"
    return json.dumps(value)


def load(model: type[ConfigT], path: str | Path, what: str) -> ConfigT:
    """Return a configuration of the class `model` from a TOML file.
    what: the expected content, in words, for messages. Raises HandbenchError for a file that is
    missing, broken or has wrong values."""
    return parse(model, read_toml(path, what), str(path))


def suggest(name: str, known: list[str]) -> str:
    """Return a hint for an unknown name: "did you mean 'x'?" with the known name of the most
    similar spelling and, of several, of the most similar letters in any order; or a list of all
    known names if none is similar."""

    def likeness(each: str) -> list[float]:
        return [
            SequenceMatcher(None, form(str(name).casefold()), form(each.casefold())).ratio()
            for form in (str, sorted)
        ]

    best = max(known, key=likeness, default="")
    if likeness(best)[0] >= 0.5:
        return f"did you mean '{best}'?"
    return f"known: {', '.join(sorted(known))}"


def checked_name(name: str) -> str:
    """Return `name` in Unicode's NFC form, if it can be part of a file name.
    Raises ValueError for a name that leads to another folder, is hidden, reads as an option, begins
    or ends with a blank, is longer than 100 bytes (NAME_BYTES), cannot be printed, or contains '|',
    or '__', with which handbench separates names."""
    name = one_form(name)
    if (
        not 1 <= len(name.encode("utf-8", "replace")) <= NAME_BYTES
        or not name.isprintable()
        or re.search(r"^[-.\s]|\s$|[/\\|]|__", name)
    ):
        raise ValueError(
            f"{name[:80]!r} cannot be the name of a file; use 1 to {NAME_BYTES} letters, digits, "
            "'-' and single '_'"
        )
    return name


# a tone of a radar, hertz; a coordinate near it, metres
Tone = Annotated[float, pydantic.Field(ge=1e6, le=1e13)]
Near = Annotated[float, pydantic.Field(ge=-100, le=100)]
FileName = Annotated[str, pydantic.AfterValidator(one_form)]
Name = Annotated[str, pydantic.AfterValidator(checked_name)]  # of a capture, a benchmark, …
