"""Runs as processes: ended by signals at random moments, short of memory, without the folders that
they expect."""

from __future__ import annotations

import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from tests.bench.run.faults import content
from tests.bench.run.photographed import RUN
from tests.faults.commands import Ended
from tests.faults.disk import Try

ROOT = Path(__file__).parents[2]
HANG_S, HUNG = 300.0, 999
SIGNALS = {"kill -9": signal.SIGKILL, "SIGTERM": signal.SIGTERM, "SIGINT": signal.SIGINT}
DIED = {signal.SIGKILL: {-9}, signal.SIGTERM: {-15}, signal.SIGINT: {130, -2}}
LIMITED = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2); del "
    "sys.argv[1]; "
    "from handbench.cli.main import main; sys.exit(main())"
)
WITHOUT_RIGHTS = (
    "from tests.bench.run.faults import nobody_s_rights\n"
    "import sys\nwith nobody_s_rights():\n from handbench.cli.main import main; sys.exit(main())"
)


@dataclass
class Runs:
    """Runs of a benchmark; with photographs, whose photogrammetry stands for itself."""

    bench: Path
    scratch: Path
    photographs: bool = True
    number: int = field(default=0)

    def command(self, out: Path) -> list[str]:
        """The words of a run into a folder, as a process of its own."""
        return [sys.executable, "-c", RUN, str(self.bench), str(out), "never"]

    def new(self) -> Path:
        """A folder that is not there yet."""
        self.number += 1
        return self.scratch / f"{self.bench.parent.name}-out{self.number}"

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
        self.forks.stdin.write(f"{out}\t{self.scratch / 'said'}\t{last}\n")
        self.forks.stdin.flush()
        return int(self.forks.stdout.readline())

    def stopped(
        self, out: Path, sent: int, moment_s: float, last: str = "never"
    ) -> tuple[int, str]:
        """Run into the folder, and send a signal after so many seconds: exit code, and what was
        said on stderr."""
        process, start = self.started(out, last), time.monotonic()
        ended, _, _ = select.select([self.forks.stdout], [], [], moment_s)
        if not ended:
            os.kill(process, sent)
            ended, _, _ = select.select([self.forks.stdout], [], [], HANG_S)
        if not ended:
            os.kill(process, signal.SIGKILL)
        self.seconds = time.monotonic() - start
        code = int(self.forks.stdout.readline())
        return code if ended else HUNG, (self.scratch / "said").read_text()

    def run(self, out: Path, last: str = "never") -> tuple[int, str]:
        """Run into the folder to the end, or to that of the first stage `last`."""
        return self.stopped(out, signal.SIGKILL, HANG_S, last)

    @cached_property
    def undisturbed(self) -> tuple[float, dict[str, bytes]]:
        """Seconds of a run whose kernels are compiled, and what it leaves."""
        for _ in range(2):
            out = self.new()
            if (ended := self.run(out))[0] != 0:
                raise RuntimeError(ended[1])
        return self.seconds, content(out)

    def resumed(self, out: Path) -> str | None:
        """Run into the folder once more; what is not as an undisturbed run leaves it, or None."""
        code, said = self.run(out)
        if code:
            return f"the resumed run ended with {code}: {said[-500:]}"
        found, expected = content(out), self.undisturbed[1]
        shutil.rmtree(out)
        wrong = sorted(
            name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name)
        )
        return f"{wrong[0]} differs" if wrong else None


def stopped(runs: Runs, name: str, count: int, generator: np.random.Generator) -> Iterator[Try]:
    """`count` runs stopped by a signal at moments drawn from all of a run, then resumed."""
    sent, tries, whole_s = SIGNALS[name], 0, runs.undisturbed[0]
    while tries < count:
        out, moment_s = runs.new(), generator.uniform(0.0, 1.0) * whole_s
        code, said = runs.stopped(out, sent, moment_s)
        if code == 0:  # it had ended: the machine is quieter by now
            whole_s = runs.seconds
            shutil.rmtree(out)
            continue
        tries += 1
        loss = None if code in DIED[sent] else f"ended with {code}: {said[-800:]}"
        if "Traceback" in said:
            loss = f"a traceback: {said[-800:]}"
        stages = len(list(out.glob("work/[!.]*")))
        yield Try(name, f"{moment_s:.2f} s, {stages} stages done", loss or runs.resumed(out))


def short_of_memory(words: str, out: Path, limits_mb: tuple[int, ...]) -> Iterator[Try]:
    """A command within `ulimit -v` of so many megabytes: it ends well, or in one sentence."""
    for limit_mb in limits_mb:
        _empty(out)
        done = subprocess.run([sys.executable, "-c", LIMITED, str(limit_mb * 2**20), *words.split()],
                              capture_output=True, text=True, cwd=ROOT, timeout=HANG_S)  # fmt: skip
        said = Ended(done.returncode, done.stderr)
        yield Try("ulimit -v", f"{words.split()[0]}, {limit_mb} MB: {done.returncode}", said.loss)


def unwritable(words: str, out: Path, places: Path) -> Iterator[Try]:
    """HOME, TMPDIR, the cache of numba, or all of them are read-only, missing or a file: the
    command does without."""
    places.mkdir()
    (places / "read_only").mkdir(mode=0o555)
    (places / "file").touch()
    every = ("HOME", "TMPDIR", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "MPLCONFIGDIR")
    for names in (*[(name,) for name in every], every):
        for kind in ("read_only", "missing", "file"):
            _empty(out)
            environment = {**os.environ, **dict.fromkeys(names, str(places / kind))}
            done = subprocess.run([sys.executable, "-c", WITHOUT_RIGHTS, *words.split()], capture_output=True,
                                  text=True, cwd=ROOT, timeout=HANG_S, env=environment)  # fmt: skip
            said = Ended(done.returncode, done.stderr)
            yield Try("unwritable HOME, TMPDIR, caches", f"{words.split()[0]}, {'+'.join(names)} "
                                                         f"{kind}: "
                      f"{done.returncode}", said.loss)  # fmt: skip


def _empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
