"""One mutant's trial: the tests that run its line, quickest first, in a fork of a process that has
the libraries."""

from __future__ import annotations

import ast
import json
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.mutation.mutants import Mutant

PACKAGES = ("radar", "calibration", "groundtruth", "bench")
BUDGET_S = 25.0  # of tests a mutant, as they were timed when the lines were mapped
SLACK_S, FACTOR, COMPILING_S = 40.0, 4.0, 100.0  # a mutant that takes longer hangs
QUIETLY = [
    "-x",
    "-q",
    "-p",
    "no:cacheprovider",
    "-p",
    "no:xdist",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
]
PASSED, FAILED = (
    0,
    1,
)  # pytest's exit codes; with another, of a module that cannot be imported, one looks twice


@dataclass(frozen=True)
class Outcome:
    """killed, survived, or timed out (which counts as killed); the tests that were run at most."""

    verdict: str
    tests: int
    seconds: float


class Trials:
    """Trials in a copy of the repository, with its map of lines to tests."""

    def __init__(self, tree: Path, lines: Path) -> None:
        self.tree, self.log = tree, tree.parent / "trial.log"
        found = json.loads(lines.read_text())
        self.tests, self.seconds, self.lines = found["tests"], found["seconds"], found["lines"]
        self.importers = {
            file: _importers(tree, file) for file in self.lines if file.startswith(PACKAGES)
        }
        self.kernels = {
            file for file in self.importers if "jit" in (tree / file).read_text(encoding="utf-8")
        }

    def chosen(self, mutant: Mutant) -> list[str]:
        """The tests that run the line; then those that run its file (what is cached, or decided at
        import, shows there) or, of a compiled line, a file that imports it: quickest first,
        BUDGET_S in all."""
        file = self.lines.get(mutant.file, {})
        ranks: dict[int, int] = dict.fromkeys(file.get(str(mutant.line), []), 0)
        for line in file.values():
            for test in line:
                ranks.setdefault(test, 1)
        if mutant.kernel or not ranks:
            for importer in self.importers.get(mutant.file, ()):
                for line in self.lines.get(importer, {}).values():
                    for test in line:
                        ranks.setdefault(test, 2)
        order, spent = [], 0.0
        for test in sorted(ranks, key=lambda test: (ranks[test], self.seconds[test])):
            spent += self.seconds[test]
            if order and spent > BUDGET_S:
                break
            order.append(test)
        return [self.tests[test] for test in order]

    def outcome(self, mutant: Mutant) -> Outcome:
        """Try a mutant."""
        start, chosen = time.monotonic(), self.chosen(mutant)
        if not chosen:
            return Outcome("survived", 0, 0.0)
        index = {name: k for k, name in enumerate(self.tests)}
        limit_s = SLACK_S + FACTOR * sum(self.seconds[index[test]] for test in chosen)
        compiled = mutant.file in self.kernels
        with self._changed(mutant, compiled):
            code = self._run(chosen, limit_s + COMPILING_S * compiled)
        if code not in (None, PASSED, FAILED) and self._run(chosen, limit_s) != PASSED:
            raise RuntimeError(f"{mutant.name}: the tests do not pass without it: see {self.log}")
        verdict = "timed out" if code is None else "survived" if code == PASSED else "killed"
        return Outcome(verdict, len(chosen), time.monotonic() - start)

    @contextmanager
    def _changed(self, mutant: Mutant, compiled: bool) -> Iterator[None]:
        """The file with the change, in the block; what numba keeps of it and its callers is put
        aside."""
        path, state = self.tree / mutant.file, (self.tree / mutant.file).stat()
        source, aside = path.read_bytes(), self.tree.parent / "compiled"
        kept = list(_compiled(self.tree)) if compiled else []
        if compiled:
            shutil.rmtree(aside, ignore_errors=True)
            for file in kept:
                (aside / file.relative_to(self.tree)).parent.mkdir(parents=True, exist_ok=True)
                os.link(file, aside / file.relative_to(self.tree))
            stale = {Path(file).stem for file in self.importers[mutant.file]} | {path.stem}
            for file in kept:
                if file.name.partition(".")[0] in stale:
                    file.unlink()
        try:
            path.write_text(mutant.code(self.tree), encoding="utf-8")
            yield
        finally:
            path.write_bytes(source)
            os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
            if compiled:
                for file in list(_compiled(self.tree)):
                    file.unlink()
                for file in kept:
                    os.link(aside / file.relative_to(self.tree), file)

    def _run(self, tests: list[str], limit_s: float) -> int | None:
        """pytest's exit code in a forked process, or None past the limit of time."""
        self.log.write_bytes(b"")
        child = os.fork()
        if child == 0:
            os.setsid()
            os.chdir(self.tree)
            log = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(log, stream)
            code = 3
            try:
                code = int(pytest.main([*QUIETLY, *tests]))
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status)
            if b"Fatal Python error" in self.log.read_bytes()[:1000]:  # after which it may hang
                break
            time.sleep(0.1)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        with suppress(ProcessLookupError):  # before it had a group of its own
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return None


def _compiled(tree: Path) -> Iterator[Path]:
    for package in PACKAGES:
        for suffix in ("nbi", "nbc"):
            yield from (tree / package).rglob(f"__pycache__/*.{suffix}")


def _importers(tree: Path, file: str) -> set[str]:
    """The files that import a file, directly or through others."""
    found: set[str] = set()
    waiting = [file]
    while waiting:
        for importer in _direct(tree).get(waiting.pop().removesuffix(".py").replace("/", "."), ()):
            if importer not in found:
                found.add(importer)
                waiting.append(importer)
    return found


_DIRECT: dict[Path, dict[str, set[str]]] = {}


def _direct(tree: Path) -> dict[str, set[str]]:
    """Module → the files that import it by themselves."""
    if tree not in _DIRECT:
        found: dict[str, set[str]] = {}
        for package in PACKAGES:
            for path in (tree / package).rglob("*.py"):
                for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                    names = []
                    if isinstance(node, ast.Import):
                        names = [alias.name for alias in node.names]
                    elif isinstance(node, ast.ImportFrom) and node.module:
                        names = [
                            node.module,
                            *(f"{node.module}.{alias.name}" for alias in node.names),
                        ]
                    for name in names:
                        found.setdefault(name.removeprefix("handbench."), set()).add(
                            path.relative_to(tree).as_posix()
                        )
        _DIRECT[tree] = found
    return _DIRECT[tree]
