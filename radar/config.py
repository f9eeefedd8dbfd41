"""Strict configuration: every key known, every value checked, the nearest key suggested for a typo."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from radar.errors import HandbenchError
from radar.files import require_file

ConfigT = TypeVar("ConfigT", bound="Config")


class Config(pydantic.BaseModel):
    """Base of every configuration: immutable, no unknown key at any level, no NaN, defaults checked too."""

    model_config = pydantic.ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True, protected_namespaces=()
    )


def parse(model: type[ConfigT], values: dict[str, Any], where: str) -> ConfigT:
    """Build `model` from plain `values`; `where` (a file or an option) opens the one-line error."""
    try:
        return model.model_validate(values)
    except pydantic.ValidationError as error:
        raise HandbenchError(_one_line(model, error, where)) from None


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Parse a TOML file into plain values; a missing or broken file is a HandbenchError."""
    path = require_file(path, what)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise HandbenchError(f"{path}: is not readable as TOML ({error}); expected {what}") from error


def load(model: type[ConfigT], path: str | Path, what: str) -> ConfigT:
    """`read_toml` and `parse` in one."""
    return parse(model, read_toml(path, what), str(path))


def suggest(name: str, known: list[str]) -> str:
    """', did you mean "x"?' for the nearest known name, followed by the whole list when nothing is near."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(sorted(known))}"


def _one_line(model: type[Config], error: pydantic.ValidationError, where: str) -> str:
    problems = error.errors()
    first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    location = ".".join(str(part) for part in first["loc"]) or "the file"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    if first["type"] == "extra_forbidden":
        known = list(_model_at(model, first["loc"][:-1]).model_fields)
        return f"{where}: unknown key '{location}'; {suggest(str(first['loc'][-1]), known)}{more}"
    if first["type"] == "missing":
        return f"{where}: key '{location}' is missing; add it{more}"
    got = repr(first["input"])
    got = got if len(got) < 80 else got[:77] + "..."
    return f"{where}: '{location}' is {got}; {first['msg'].lower()}{more}"


def _model_at(model: type[Config], location: tuple[Any, ...]) -> type[Config]:
    """The nested model at an error's location, found by following field annotations."""
    for part in location:
        field = model.model_fields.get(str(part))
        if field is None:  # a list index or the tag of a union: the model is already the right one, or a tagged one
            continue
        model = next((m for m in _models_in(field.annotation)), model)
    return model


def _models_in(annotation: Any) -> list[type[Config]]:
    if isinstance(annotation, type) and issubclass(annotation, Config):
        return [annotation]
    return [m for argument in getattr(annotation, "__args__", ()) for m in _models_in(argument)]
