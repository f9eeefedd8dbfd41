"""Differences in the provenance of two results: configuration, settings of the methods, versions,
machines, inputs."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from handbench.bench.evaluation.tables import CHANGES, frame
from handbench.bench.results.result_folder import Result
from handbench.support.config import plain_toml

HASH_CHARACTERS = 12  # enough to distinguish two hashes


def changes(a: Result, b: Result) -> pd.DataFrame:
    """List what differs between two results besides their figures, as the table CHANGES:
    configuration, settings of the methods, versions, machine, inputs.
    A line has the values of A and B for one key; a value is empty if that result does not have the
    key."""
    kinds = (
        ("configuration", _configuration(a), _configuration(b)),
        ("settings", _settings(a, b), _settings(b, a)),
        ("version", a.about.versions, b.about.versions),
        ("machine", _flat(a.about.machine), _flat(b.about.machine)),
        ("input", _inputs(a), _inputs(b)),
    )
    lines = (
        (what, key, str(ours.get(key, "")), str(theirs.get(key, "")))
        for what, ours, theirs in kinds
        for key in dict.fromkeys((*ours, *theirs))
        if ours.get(key) != theirs.get(key)
    )
    return frame(CHANGES, lines)


def _configuration(result: Result) -> dict[str, Any]:
    try:
        return _flat(plain_toml(result.config))
    # a record, not an input: that it cannot be read must not hide the figures
    except (ValueError, RecursionError):
        return {"config.toml": "not readable as TOML"}


def _settings(result: Result, other: Result) -> dict[str, str]:
    """Return the settings of the methods that `other` has too: "method.key" → value.
    If a setting differs between captures, its values are joined by " / "."""
    shared = {method.name for method in other.about.methods}
    values: dict[str, list[str]] = {}
    for method in result.about.methods:
        for config in method.config.values() if method.name in shared else ():
            for key, value in _flat(config if isinstance(config, dict) else {"": config}).items():
                values.setdefault(f"{method.name}.{key}", []).append(str(value))
    return {key: " / ".join(dict.fromkeys(texts)) for key, texts in values.items()}


def _inputs(result: Result) -> dict[str, str]:
    return {name: digest[:HASH_CHARACTERS] for name, digest in result.about.inputs.items()}


def _flat(value: Any) -> dict[str, Any]:
    """Flatten nested tables and lists of tables: key with dots → value."""
    return dict(_leaves(value, ""))


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _leaves(item, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        for place, item in enumerate(value):
            name = next(
                (item[label] for label in ("id", "name", "scene", "path") if label in item), place
            )
            yield from _leaves(item, f"{key}.{name}")
    else:
        yield key, value
