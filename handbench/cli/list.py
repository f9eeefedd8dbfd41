"""`handbench list`: one line for each method, metric, benchmark, effect, data set and pose, or one
of them in full."""

import argparse
import textwrap
from collections.abc import Iterator
from shutil import get_terminal_size
from typing import Any, NamedTuple

from handbench.bench.benchmarks.benchmark_file import embedded_benchmarks
from handbench.bench.datasets.dataset import FOREIGN, IMPORTERS
from handbench.bench.evaluation.metrics import METRICS, definitions
from handbench.bench.scenes.hand_pose import POSES
from handbench.radar.methods.registry import METHODS, Method
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.progress import print_lines, print_wrapped

SECTIONS = ("methods", "metrics", "benchmarks", "effects", "datasets", "poses")
TERM = 24  # characters before the meaning of a term, which follows a longer one
GIGA = 1e9


class Entry(NamedTuple):
    """One thing in a list. note: printed at the end of its line; details: term → meaning, printed
    for the entry in full."""

    name: str
    summary: str
    note: str = ""
    details: dict[str, str] = {}  # noqa: RUF012  never changed


def run(options: argparse.Namespace) -> None:
    """Print a line for each entry of all sections or of one, or one entry in full. Raises
    HandbenchError for an entry that the section does not have."""
    for section in [options.section] if options.section else SECTIONS:
        entries = {entry.name: entry for entry in _entries(section)}
        if options.name is None:
            _print_lines(section, list(entries.values()))
        elif options.name in entries:
            _print_in_full(entries[options.name])
        else:
            hint = suggest(options.name, list(entries))
            raise HandbenchError(f"list {section}: has no '{options.name}'; {hint}")
    if options.section is None:
        print_lines("one of them in full: handbench list methods 3fsk")


def _print_lines(section: str, entries: list[Entry]) -> None:
    """Print a section with one line for each entry, cut to the width of the terminal."""
    name, summary, note = (
        max(map(len, texts)) for texts in zip(*(e[:3] for e in entries), strict=True)
    )
    room = max(min(summary, get_terminal_size().columns - name - note - 6), 1)
    print_lines(section)
    for entry in entries:
        text = textwrap.shorten(entry.summary, room, placeholder="…")
        print_lines(f"  {entry.name:<{name}}  {text:<{room}}  {entry.note}".rstrip())


def _print_in_full(entry: Entry) -> None:
    print_lines(f"{entry.name}: {entry.summary}")
    for term, meaning in entry.details.items():
        print_wrapped(f"  {term:<{TERM}}  {meaning}", " " * (TERM + 4))


def _entries(section: str) -> Iterator[Entry]:
    if section == "methods":
        yield from map(_method, METHODS.values())
    elif section == "metrics":
        for key, definition in definitions().items():
            yield Entry(key, METRICS[key].title, METRICS[key].unit, {"definition": definition})
    elif section == "benchmarks":
        for name, file in embedded_benchmarks().items():
            yield Entry(name, file.read_text("utf-8").partition("\n")[0].removeprefix("# "))
    elif section == "effects":
        for effect in EFFECTS:
            yield Entry(effect.id, effect.does, details={"source": effect.source})
    elif section == "datasets":
        for name, reader in (FOREIGN | IMPORTERS).items():
            summary = " ".join((reader.__doc__ or "").split()).partition(". ")[0]
            yield Entry(name, summary, "to import" if name in IMPORTERS else "")
    else:
        yield Entry("letters", " ".join(POSES))


def _method(method: Method) -> Entry:
    """Return the entry of a method, whose details are its parameters with their defaults."""
    details = {"source": method.source}
    for key, value in method.defaults.model_dump().items():
        meaning = type(method.defaults).model_fields[key].description or ""
        details[f"{key} = {_toml(value)}"] = meaning
    return Entry(method.id, method.summary, method.source.split()[0], details)


def _toml(value: Any) -> str:
    """Return a parameter's value as one writes it in a benchmark file, with tones as 82e9."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(part)}' for key, part in value.items())} }}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return f"{value / GIGA:g}e9" if value >= GIGA else f"{value:g}"
    return str(value).lower()
