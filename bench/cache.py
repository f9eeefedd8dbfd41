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
from pathlib import Path
from typing import Any

from bench.measure import Cost, measured
from bench.results import Task
from radar.errors import HandbenchError
from radar.files import read_json, write_json
from radar.kept import keep, key_of
from radar.progress import say

STAMP, MARKER = "stage.json", ".handbench-run"


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
        key = key_of(sources, name, capture, method, *depends_on)
        label = "-".join(part for part in (name, capture, method) if part)
        folder = self.root / f"{label}-{key[:16]}"

        def timed(temporary: Path) -> None:
            say(f"{label} ...")
            with measured() as cost:
                make(temporary)
            write_json(temporary / STAMP, asdict(cost))

        cached = keep(folder, timed)
        cost = Cost(**read_json(folder / STAMP, "a stage's stamp"))
        say(f"{label}: cached" if cached else f"{label}: {cost.seconds:.1f} s")
        self.tasks.append(Task(label, capture, method, name, **asdict(cost), cached=cached))
        return Stage(folder, key, cost)


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
