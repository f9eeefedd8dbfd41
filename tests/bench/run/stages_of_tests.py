"""Stages that stand for the real ones, and an engine that carries them out. Processes import this
file: it imports little."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING

from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.parallel import workers
from handbench.support.store import Stage, stage

if TYPE_CHECKING:
    from handbench.bench.run.engine import Engine

SPAN_S = 0.2
SPAN = "span.json"


@stage("mesh", "support/errors.py")
def act(folder: Path) -> None:
    """Does what the capture's name says; else writes in which process, with how many threads."""
    capture = folder.name.split("-")[1]
    if capture == "bug":
        raise ZeroDivisionError("a bug")
    if capture == "bad":
        raise HandbenchError("mend me")
    if capture == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    write_json(folder / "pid.json", os.getpid())
    time.sleep({"endless": 1000, "slow": 10 * SPAN_S}.get(capture, SPAN_S))
    write_json(folder / SPAN, [os.getpid(), workers()])


def stages_of(*captures: str, shares: bool = True) -> list[Stage]:
    """A stage for each capture, with a key of its own."""
    return [Stage(act, {}, capture, f"m{n}", shares) for n, capture in enumerate(captures)]


def engine_of(root: Path, executor: Executor | None) -> Engine:
    """An engine with its stages in the folder `root`."""
    from handbench.bench.run.engine import Engine
    from handbench.support.progress import Work

    root.mkdir(exist_ok=True)
    return Engine(root, Work(0), executor)
