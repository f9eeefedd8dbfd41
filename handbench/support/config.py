"""Configurations that are checked strictly: every key must be known and every value valid. For a
mistyped key, the nearest known one is suggested."""

import difflib
import re
import tomllib
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Self, TypeVar, Union, get_args, get_origin

import pydantic

from handbench.support.errors import HandbenchError
from handbench.support.files import at_fault, one_form, read_text
from handbench.support.limits import (
    LONG_KEY,
    MOST_PROBLEMS,
    NAME_BYTES,
    TOML_BYTES,
    require_shallow,
)

ConfigT = TypeVar("ConfigT", bound="Config")
SMALLEST, LARGEST = 1e-30, 1e30  # of a number's size
UNITS = {  # ending of a key: factor from another unit → what may be wrong
    "_hz": {1e9: "in gigahertz", 1e6: "in megahertz", 1e-3: "a thousand times too much"},
    "_m": {1e-3: "in millimetres"},
}
HIGH_HZ = 1e12  # a higher guess is none


class Config(pydantic.BaseModel):
    """Base class of every configuration. Its values cannot be changed.
    Errors are: an unknown key at any level, NaN or infinity, and a number so large or small that no
    quantity in SI units has this size. Default values are checked too."""

    model_config = pydantic.ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        validate_default=True,
        protected_namespaces=(),
    )

    @pydantic.model_validator(mode="after")
    def _in_range(self) -> Self:
        """Refuse numbers so small or so large that they would vanish or overflow in float32.
        Numbers in a tuple, such as coordinates, may be that small, because rounding can cause
        it."""
        for name, value in self:
            for key, number in _numbers(name, value):
                vanishes = number and number is value and abs(number) < SMALLEST
                if abs(number) > LARGEST or vanishes:
                    # a float cannot hold every whole number
                    given = number if isinstance(number, float) else Decimal(number)
                    raise ValueError(
                        f"{key} is {given:.4g}; expected 0 or a size from {SMALLEST:g} to "
                        f"{LARGEST:g}"
                    )
        return self


def _numbers(key: str, value: object) -> Iterator[tuple[str, int | float]]:
    """Yield key and value of a number, or of every number in a tuple, list or table, with a dotted
    key such as "box_m.2"."""
    if isinstance(value, int | float):
        yield key, value
    elif isinstance(value, tuple | list | dict):
        parts = value.items() if isinstance(value, dict) else enumerate(value)
        for inner, part in parts:
            yield from _numbers(f"{key}.{inner}", part)


def parse(model: type[ConfigT], values: dict[str, Any], where: str) -> ConfigT:
    """Return a configuration of the class `model` from plain values, such as those of a TOML file.
    where: a file or an option, with which the message begins. Raises HandbenchError that says in
    one line what is wrong."""
    try:
        return model.model_validate(values)
    except pydantic.ValidationError as error:
        # telling them apart takes a thousand times what finding them does
        if error.error_count() > MOST_PROBLEMS:
            message = (
                f"{where}: {error.error_count()} of its values are wrong; check that it is the "
                "right file"
            )
            raise HandbenchError(message) from None
        problems = error.errors()
        first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
        # all of them: they are added at once
        also = [p for p in problems if p["type"] == "missing" and p is not first]
        more = f" (and {others} more)" if (others := len(problems) - 1 - len(also)) else ""
        complaints = "; ".join(complaint(model, problem) for problem in (first, *also))
        raise HandbenchError(f"{where}: {complaints}{more}") from None


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Return the content of a TOML file as plain values.
    what: the expected content, in words, for messages. Raises HandbenchError for a missing or
    broken file."""
    text = ""
    try:
        text = read_text(path, what, TOML_BYTES)
        return plain_toml(text)
    except (
        ValueError,
        RecursionError,
    ) as error:  # whole numbers of 5000 digits are no TOMLDecodeError
        raise HandbenchError(
            f"{path}: is not readable as TOML ({at_fault(error, text)}); expected {what}"
        ) from error


def plain_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML text as plain values. Raises ValueError for text that is invalid
    or too deeply nested (for some deep nesting RecursionError)."""
    if LONG_KEY.search(text):
        raise ValueError("a key has too many parts (32 or more, separated by points)")
    return require_shallow(tomllib.loads(text))


def load(model: type[ConfigT], path: str | Path, what: str) -> ConfigT:
    """Return a configuration of the class `model` from a TOML file.
    what: the expected content, in words, for messages. Raises HandbenchError for a file that is
    missing, broken or has wrong values."""
    return parse(model, read_toml(path, what), str(path))


def suggest(name: str, known: list[str]) -> str:
    """Return a hint for an unknown name: "did you mean 'x'?" with the known name of similar
    letters, or a list of all known names if none is similar."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    near = near or difflib.get_close_matches(name.casefold(), known, n=1, cutoff=0.5)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(sorted(known))}"


def complaint(model: type[Config], problem: Any, prefix: tuple[int | str, ...] = ()) -> str:
    """Describe in words what is wrong with one value of a configuration.
    problem: pydantic's description of the error; prefix: keys that lead from the top of the file to
    the values of the configuration."""
    models, keys = _follow(model, problem["loc"])
    location = ".".join(map(str, (*prefix, *keys))) or "the file"
    if problem["type"] == "extra_forbidden":
        known = [name for m in models for name in m.model_fields]
        return f"unknown key '{location}'; {suggest(str(problem['loc'][-1]), known)}"
    if problem["type"] == "missing":
        return f"key '{location}' is missing; add it"
    given, message, bounds = problem["input"], problem["msg"], problem.get("ctx", {})
    if problem["type"] == "union_tag_invalid":
        location, given = ".".join((location, bounds["discriminator"][1:-1])), bounds["tag"]
        bounds = {"expected": bounds["expected_tags"]}
        message = f"expected {bounds['expected']}"
    try:
        got = repr(given)
    except RecursionError:
        got = "a list or table nested without end"
    got = got if len(got) < 80 else got[:77] + "..."
    message = message.removeprefix("Value error, ")
    hint = suggest(str(given), re.findall("'([^']*)'", bounds.get("expected", "")))
    # of a unit ("mm"), a similar one is another
    hint = f"{hint} " if hint.startswith("did") and len(str(given)) > 2 else ""
    unit = _unit_hint(str(next((k for k in reversed(keys) if not k.isdigit()), "")), given, bounds)
    return f"'{location}' is {got}; {hint}{message[0].lower()}{message[1:]}{unit}"


def _unit_hint(key: str, value: Any, bounds: dict[str, Any]) -> str:
    """Return a hint that a length or frequency outside its bounds may be in another unit, if it
    would be within the bounds in that unit; "" otherwise.
    key: name of the value. bounds: allowed range from pydantic's error, "ge" and "le"."""
    low, high = bounds.get("ge", -HIGH_HZ), min(bounds.get("le", HIGH_HZ), HIGH_HZ)
    if bounds.keys() & {"ge", "le"} and isinstance(value, int | float):
        for ending, units in UNITS.items():
            for factor, unit in units.items() if key.endswith(ending) else ():
                if low <= factor * value <= high:
                    return f"; if that is {unit}, multiply it by {factor:g}"
    return ""


def _follow(
    model: type[Config], location: tuple[int | str, ...]
) -> tuple[list[type[Config]], list[str]]:
    """Return the configuration classes to which a wrong value may belong, and the keys that lead to
    the value in the file.
    location: place of the value as pydantic gives it; if alternatives of a union exist, it also
    names the chosen class."""
    models, keys = [model], []
    fields: list[Any] = []
    for part in location:
        if isinstance(part, str) and any(_is_choice_of_values(f.annotation) for f in fields):
            continue  # the alternative's name, which is no key
        tagged = [m for m in models if len(models) > 1 and _is_tagged(m, part)]
        if tagged:
            models = tagged
            continue
        keys.append(str(part))
        fields = [m.model_fields[part] for m in models if part in m.model_fields]
        models = [inner for field in fields for inner in _models_in(field.annotation)] or models
    return models, keys


def _is_choice_of_values(annotation: Any) -> bool:
    """Return True for a union of plain values, such as a number or a word."""
    return get_origin(annotation) in (Union, UnionType) and not _models_in(annotation)


def _is_tagged(model: type[Config], part: int | str) -> bool:
    literals = (
        f.annotation for f in model.model_fields.values() if get_origin(f.annotation) is Literal
    )
    return part == model.__name__ or any(part in get_args(literal) for literal in literals)


def _models_in(annotation: Any) -> list[type[Config]]:
    if isinstance(annotation, type) and issubclass(annotation, Config):
        return [annotation]
    return [m for argument in get_args(annotation) for m in _models_in(argument)]


def checked_name(name: str) -> str:
    """Return `name` in Unicode's NFC form, if it can be part of a file name.
    Raises ValueError for a name that leads to another folder, is hidden, is longer than 80
    characters or 100 bytes (NAME_BYTES), cannot be printed, or contains '__', with which handbench
    separates names."""
    name = one_form(name)
    unfit = (
        not name.isprintable()
        or name.startswith(".")
        or any(part in name for part in ("/", "\\", "__"))
    )
    if len(name) <= 80 and (size := len(name.encode("utf-8", "replace"))) > NAME_BYTES:
        raise ValueError(
            f"is a name of {size} bytes; use at most {NAME_BYTES} bytes, because files are named "
            "after it"
        )
    if unfit or not 1 <= len(name) <= 80:
        raise ValueError(
            f"{name[:80]!r} cannot be the name of a file; use 1 to 80 letters, digits, '-' and "
            "single '_'"
        )
    return name


# a tone of a radar, hertz; a coordinate near it, metres
Tone = Annotated[float, pydantic.Field(ge=1e6, le=1e13)]
Near = Annotated[float, pydantic.Field(ge=-100, le=100)]
FileName = Annotated[str, pydantic.AfterValidator(one_form)]
Name = Annotated[str, pydantic.AfterValidator(checked_name)]  # of a capture, a benchmark, …
