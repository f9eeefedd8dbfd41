"""Stages of a run, each kept in a folder named by the hash of everything that it depends on.

A stage's folder appears complete or not at all, so that a run that was killed goes on where it stopped and a changed
input, configuration or source file never meets a stale result.
"""

from __future__ import annotations

import fcntl
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from bench.measure import Cost, measured, versions
from bench.results import Task
from radar.errors import HandbenchError
from radar.files import atomic_folder, content_hash, read_json, write_json
from radar.progress import say

STAMP, MARKER = "stage.json", ".handbench-run"
PACKAGES = Path(__file__).parent.parent


@dataclass(frozen=True)
class Stage:
    """A finished stage: its folder, the hash that names it, what it cost when it was made."""

    folder: Path
    key: str
    cost: Cost


@dataclass
class Cache:
    """The stages under `root`; `tasks` records each stage of this run, cached or not."""

    root: Path
    tasks: list[Task] = field(default_factory=list)

    def stage(
        self,
        name: str,
        capture: str,
        method: str,
        depends_on: list[Any],
        sources: tuple[str, ...],
        make: Callable[[Path], None],
    ) -> Stage:
        """The folder that make(folder) fills, from the cache when nothing it depends on has changed.

        depends_on: values, paths and keys of earlier stages; sources: packages or modules whose code it runs.
        """
        key = content_hash(name, capture, method, *depends_on, source_hash(sources), versions())
        label = "-".join(part for part in (name, capture, method) if part)
        folder = self.root / f"{label}-{key[:16]}"
        cached = (folder / STAMP).is_file()
        if cached:
            say(f"{label}: cached")
        else:
            say(f"{label} ...")
            with atomic_folder(folder) as temporary:
                with measured() as cost:
                    make(temporary)
                write_json(temporary / STAMP, asdict(cost))
            say(f"{label}: {cost.seconds:.1f} s")
        cost = Cost(**read_json(folder / STAMP, "a stage's stamp"))
        self.tasks.append(Task(label, capture, method, name, **asdict(cost), cached=cached))
        return Stage(folder, key, cost)


@cache  # of the code as it was when the run began, which is the code that runs
def source_hash(sources: tuple[str, ...]) -> str:
    """Hash of the Python files of packages and modules, given as paths under the installation: radar, bench/x.py."""
    files = []
    for source in sources:
        path = PACKAGES / source
        files += [path] if path.is_file() else sorted(path.rglob("*.py"))
    return content_hash(*(part for file in files for part in (str(file.relative_to(PACKAGES)), file)))


@contextmanager
def claimed(folder: Path) -> Iterator[Path]:
    """Hold a result folder for this run alone and yield its `work` folder, cleared of what killed runs left.

    A marker says that a run made the folder: one without it that holds anything is a stranger's and is left alone.
    The lock falls with the process, however it ends.
    """
    if folder.exists() and not folder.is_dir():
        raise HandbenchError(f"{folder}: is a file; expected a folder for the results: choose another -o")
    if folder.is_dir() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise HandbenchError(f"{folder}: holds files that no run wrote; choose an empty or new folder for -o")
    work = folder / "work"
    work.mkdir(parents=True, exist_ok=True)
    with (folder / MARKER).open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise HandbenchError(f"{folder}: another run is writing here; wait for it or choose another -o") from None
        for leftover in work.glob(".*-*"):
            shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()
        yield work
