"""Runs as processes, that signals can end."""

from __future__ import annotations

import select
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
HANG_S = 300.0


@dataclass
class Runs:
    """Runs of a benchmark; with photographs, whose photogrammetry stands for itself."""

    bench: Path
    scratch: Path
    photographs: bool = True

    @cached_property
    def forks(self) -> subprocess.Popen:
        """The process that carries out runs in forks of itself."""
        kind = "photographs" if self.photographs else "plain"
        command = [sys.executable, "-m", "tests.faults.forked", str(self.bench), kind]
        return subprocess.Popen(command, stdin=-1, stdout=-1, text=True, cwd=ROOT)

    def end(self) -> None:
        """End the process that carries out runs."""
        self.forks.communicate()

    def started(self, out: Path, last: str = "never") -> int:
        """Begin a run into the folder, which ends after the first stage `last`: the number of its
        process."""
        self.start = time.monotonic()
        self.forks.stdin.write(f"{out}\t{self.scratch / 'stderr'}\t{last}\n")
        self.forks.stdin.flush()
        return int(self.forks.stdout.readline())

    def ended(self) -> tuple[int, str]:
        """Wait for the run to end: its exit code, and what it wrote to stderr."""
        assert select.select([self.forks.stdout], [], [], HANG_S)[0], "the run hangs"
        self.seconds = time.monotonic() - self.start
        return int(self.forks.stdout.readline()), (self.scratch / "stderr").read_text()

    def run(self, out: Path, last: str = "never") -> tuple[int, str]:
        """Run into the folder to the end, or to that of the first stage `last`."""
        self.started(out, last)
        return self.ended()
