"""`handbench list` and `doctor`: the methods, metrics, benchmarks, effects, data sets and poses
that are installed, and the parts of this machine."""

import argparse
import shutil
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from handbench.bench.benchmarks.benchmark_file import BenchFile, embedded_benchmarks
from handbench.bench.datasets.dataset import FOREIGN, IMPORTERS
from handbench.bench.evaluation.metrics import METRICS, definitions
from handbench.bench.scenes.hand_pose import POSES
from handbench.groundtruth.cameras import cuda_devices, load_pycolmap
from handbench.radar.imaging.device import describe
from handbench.radar.methods.registry import METHODS, Method
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.support.config import inline_toml, load, suggest
from handbench.support.cost import machine
from handbench.support.errors import HandbenchError
from handbench.support.progress import print_lines, print_wrapped
from handbench.support.rays import load_open3d
from handbench.support.store import versions

TERM = 26  # characters before the meaning of a term, which follows a longer one


class Entry(NamedTuple):
    """One thing in a list. details: term → meaning, printed for the entry in full."""

    name: str
    summary: str
    details: dict[str, str] = {}  # noqa: RUF012  never changed


def list_entries(options: argparse.Namespace) -> None:
    """Print a line for each entry of all sections or of one, or one entry in full. Raises
    HandbenchError for an entry that the section does not have."""
    sections = _sections()
    for section in [options.section] if options.section else sections:
        entries = {entry.name: entry for entry in sections[section]}
        if options.name is None:
            _print_lines(section, entries.values())
        elif entry := entries.get(options.name):
            print_lines(f"{entry.name}: {entry.summary}")
            for term, meaning in entry.details.items():
                print_wrapped(f"  {term:<{TERM}}  {meaning}", " " * (TERM + 4))
        else:
            raise HandbenchError(
                f"list {section}: has no '{options.name}'; {suggest(options.name, [*entries])}"
            )
    if options.section is None:
        print_lines("one of them in full: handbench list methods 3fsk")


def _print_lines(section: str, entries: Iterable[Entry]) -> None:
    """Print a section with one line for each entry, cut to the width of the terminal."""
    room = max(shutil.get_terminal_size().columns - TERM - 4, 1)
    print_lines(section)
    for entry in entries:
        text = textwrap.shorten(entry.summary, room, placeholder="…")
        print_lines(f"  {entry.name:<{TERM}}  {text}")


def _sections() -> dict[str, list[Entry]]:
    """Return the sections of the list, by their names on the command line."""
    return {
        "methods": [_method(method) for method in METHODS.values()],
        "metrics": [
            Entry(key, f"{METRICS[key].title} ({METRICS[key].unit})", {"definition": definition})
            for key, definition in definitions().items()
        ],
        "benchmarks": [_benchmark(file) for file in embedded_benchmarks().values()],
        "effects": [Entry(effect.id, effect.does, {"source": effect.source}) for effect in EFFECTS],
        "datasets": [
            Entry(name, " ".join((reader.__doc__ or "").split()).partition(". ")[0])
            for name, reader in (FOREIGN | IMPORTERS).items()
        ],
        "poses": [Entry("letters", " ".join(POSES))],
    }


def _benchmark(file: Path) -> Entry:
    """Return the entry of a benchmark, whose details are its captures and its methods."""
    bench = load(BenchFile, file, "a benchmark description")
    scenes = (Path(source.scene or source.path or "").stem for source in bench.capture)
    details = {
        "captures": ", ".join(dict.fromkeys(scenes)),
        "methods": ", ".join(dict.fromkeys(entry.label for entry in bench.method)),
    }
    return Entry(file.stem, file.read_text("utf-8").partition("\n")[0].removeprefix("# "), details)


def _method(method: Method) -> Entry:
    """Return the entry of a method, whose details are its parameters with their defaults."""
    details = {"source": method.source}
    for key, value in method.defaults.model_dump().items():
        meaning = type(method.defaults).model_fields[key].description or ""
        details[f"{key} = {inline_toml(value)}"] = meaning
    return Entry(method.id, method.summary, details)


def doctor(options: argparse.Namespace) -> None:
    """Print this machine's libraries and parts: each works ("ok"), or has to be seen to ("--")."""
    facts, free_gb = machine(), shutil.disk_usage(".").free / 1e9
    libraries = ", ".join(f"{name} {version}" for name, version in versions().items())
    lines = [
        f"ok  Python {facts['python']}, {libraries}",
        f"ok  processor: {facts['processor']}, {facts['cores']} cores",
        f"ok  memory: {facts['memory_gb']:.0f} GB, free disk: {free_gb:.0f} GB",
    ]
    for part, require in (
        ("compiled code", _require_cache),
        ("meshes", load_open3d),
        ("photographs", load_pycolmap),
        ("imaging on a GPU", lambda: describe("cuda")),
        ("photographs on a GPU", _require_cuda),
    ):
        try:
            require()
            lines.append(f"ok  {part}")
        except (HandbenchError, ImportError, OSError) as error:
            lines.append(f"--  {part}: {error}")
    for line in lines:
        print_wrapped(line, "    ")


def _require_cache() -> None:
    """Raise HandbenchError if no folder keeps compiled code from one command to the next."""
    from handbench.support.compiled import CACHE, COMPILE_S, KEPT

    if KEPT is None:
        raise HandbenchError(
            f"no folder for it can be written, so each command compiles for some {COMPILE_S} s; "
            f"set {CACHE} to one that can"
        )


def _require_cuda() -> None:
    """Raise HandbenchError if depth maps of photographs cannot be made on a graphics card."""
    if not cuda_devices():
        raise HandbenchError(
            "not found; depth maps take a minute or two per hand on the processor; with an NVIDIA "
            "card: pip install 'handbench[cuda]'"
        )
