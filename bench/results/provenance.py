"""Differences in the provenance of two results: configuration, settings of the methods, versions,
machines, inputs."""

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from handbench.bench.evaluation.tables import CHANGES, frame
from handbench.bench.results.result_folder import Result
from handbench.support.config import plain_toml

HASH_CHARACTERS = 12  # enough to distinguish two hashes


def changes(a: Result, b: Result) -> pd.DataFrame:
    """List what differs between two results besides their figures, as the table CHANGES:
    configuration, settings of the methods that both have, versions, machine, inputs.
    A line has the values of A and B for one key; a value is empty if that result does not have the
    key."""
    methods = a.about.method_titles.keys() & b.about.method_titles.keys()
    ours, theirs = (_facts(result, methods) for result in (a, b))
    lines = (
        (*key, str(ours.get(key, "")), str(theirs.get(key, "")))
        for key in dict.fromkeys((*ours, *theirs))
        if ours.get(key) != theirs.get(key)
    )
    return frame(CHANGES, lines)


def _facts(result: Result, methods: Iterable[str]) -> dict[tuple[str, str], Any]:
    """Return all that describes a result and its `methods`: (sort, key) → value. The settings of a
    method are those for the first capture."""
    about = result.about
    try:
        config = plain_toml(result.config)
    # a record, not an input: that it cannot be read must not hide the figures
    except (ValueError, RecursionError):
        config = {"config.toml": "not readable as TOML"}
    sorts = {
        "configuration": config,
        "settings": {
            method.name: next(iter(method.config.values()), {})
            for method in about.methods
            if method.name in methods
        },
        "version": about.versions,
        "machine": about.machine,
        "input": {name: digest[:HASH_CHARACTERS] for name, digest in about.inputs.items()},
    }
    return {(sort, key): of for sort, facts in sorts.items() for key, of in _flat(facts).items()}


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Flatten nested tables and lists of tables: key with dots → value."""
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        value = {
            next((item[name] for name in ("name", "id", "scene", "path") if name in item), place): (
                item
            )
            for place, item in enumerate(value)
        }
    if not isinstance(value, Mapping):
        return {key: value}
    return {
        path: leaf
        for name, item in value.items()
        for path, leaf in _flat(item, f"{key}.{name}" if key else str(name)).items()
    }
