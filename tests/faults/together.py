"""Several processes over one benchmark: two runs at once, a scheduler that is lost, a worker of
another version."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import numpy as np

from tests.bench.run import test_schedule as cluster
from tests.bench.run.faults import content
from tests.faults.commands import Ended
from tests.faults.disk import Try
from tests.faults.processes import HANG_S, ROOT, Runs
from tests.installed_copy import copy_package


def at_once(runs: Runs, count: int, generator: np.random.Generator) -> Iterator[Try]:
    """Two runs into one folder, the second begun while the first works: one does the work, the
    other says so."""
    for _ in range(count):
        out, delay_s = runs.new(), generator.uniform(0.0, 0.5) * runs.undisturbed[0]
        both = []
        for wait_s in (delay_s, 0.0):
            both.append(
                subprocess.Popen(
                    runs.command(out), stdout=-3, stderr=subprocess.PIPE, text=True, cwd=ROOT
                )
            )
            time.sleep(wait_s)
        said = [process.communicate(timeout=HANG_S)[1] for process in both]
        codes = sorted(process.returncode for process in both)
        refused = sum("another run is writing here" in text for text in said)
        loss = next(
            filter(None, (Ended(p.returncode, s).loss for p, s in zip(both, said, strict=True))),
            None,
        )
        if loss is None and (codes, refused) not in (([0, 2], 1), ([0, 0], 0)):
            loss = f"ended with {codes}: {said}"
        yield Try("two runs at once", f"{delay_s:.2f} s apart: {codes}", loss or runs.resumed(out))


def scheduler_lost(bench: Path, scratch: Path, generator: np.random.Generator) -> Try:
    """The scheduler is killed in mid-run: the run ends in a sentence, and goes on without it."""
    scratch.mkdir()
    started, out = cluster.Workers(scratch), scratch / "out"
    try:
        command = [sys.executable, "-m", "handbench.cli.main", "run", str(bench), "-o", str(out)]
        process = subprocess.Popen([*command, "--scheduler", started.address], stdout=-3, stderr=subprocess.PIPE,
                                   text=True, cwd=ROOT)  # fmt: skip
        wanted = int(generator.integers(1, 5))
        threading.Thread(
            target=_kill_after, args=(process, started.scheduler, out / "work", wanted)
        ).start()
        said = process.communicate(timeout=HANG_S)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        return Try("scheduler lost", f"after {wanted} stages", "it hangs")
    finally:
        started.stop()
    loss = Ended(process.returncode, said).loss
    for folder in (out, scratch / "whole") if loss is None else ():
        subprocess.run([*command[:-1], str(folder)], check=True, capture_output=True, cwd=ROOT)
    if loss is None and content(out) != content(scratch / "whole"):
        loss = "the resumed run differs"
    return Try("scheduler lost", f"after {wanted} stages: {process.returncode}", loss)


def _kill_after(
    process: subprocess.Popen, scheduler: subprocess.Popen, work: Path, stages: int
) -> None:
    while process.poll() is None and cluster.finished(work) < stages:
        time.sleep(0.005)
    scheduler.kill()


def other_version(bench: Path, scratch: Path) -> Try:
    """The workers have another version of a file that a stage runs: every stage is refused in
    words."""
    edited = copy_package(scratch / "code", compiled=False) / "radar" / "simulation" / "forward.py"
    edited.write_text(
        edited.read_text(encoding="utf-8").replace("\n\n\n", "\n\n\nOTHER = 1\n\n\n", 1),
        encoding="utf-8",
    )
    with patch.object(cluster, "ENVIRONMENT", {**os.environ, "PYTHONPATH": str(scratch / "code")}):
        started = cluster.Workers(scratch)
    try:
        done = subprocess.run([sys.executable, "-m", "handbench", "run", str(bench), "-o", str(scratch / "out"),
                               "--scheduler", started.address], capture_output=True, text=True, cwd=ROOT,
                              timeout=HANG_S)  # fmt: skip
    finally:
        started.stop()
    loss = Ended(done.returncode, done.stderr).loss
    if loss is None and (done.returncode != 2 or "differ from the client's" not in done.stderr):
        loss = f"ended with {done.returncode}: {done.stderr[-300:]}"
    return Try("worker of another version", str(done.returncode), loss)
