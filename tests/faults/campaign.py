"""Kinds of faults and their tries: a handful of each for the tests, all of them for `python -m
tests.faults`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import islice
from pathlib import Path

import numpy as np

from tests.bench.run.photographed import with_photographs
from tests.bench.run.test_schedule import several
from tests.faults import disk, processes, surroundings, together
from tests.faults.commands import COMMANDS, Command, write_inputs
from tests.faults.disk import Try
from tests.small_benchmark import write_bench

QUICK = ("simulate", "groundtruth", "calibrate", "reconstruct", "import")  # in well under a second
EVERY = {"run": 5, "report": 9, "tradeoff": 7}  # of the writes of what takes seconds
LIMITS_MB = (100, 400, 1000, 2000, 2400, 2700, 3000, 4000, 6000, 8000)


@dataclass
class Ground:
    """Where faults are tried. tries: of each kind that is drawn at random; every: try all there is
    of the others, on all commands, instead of a handful on the quick ones."""

    scratch: Path
    tries: int
    every: bool
    seed: int = 0

    @cached_property
    def inputs(self) -> Path:
        """The inputs of all commands."""
        return write_inputs(self.scratch / "inputs")

    @cached_property
    def runs(self) -> processes.Runs:
        """Runs of a benchmark with photographs."""
        return processes.Runs(with_photographs(write_bench(self.scratch / "bench")), self.scratch)

    @cached_property
    def plain_runs(self) -> processes.Runs:
        """Runs of a benchmark without photographs."""
        return processes.Runs(write_bench(self.scratch / "plain"), self.scratch, photographs=False)

    @cached_property
    def commands(self) -> list[Command]:
        """The commands to try."""
        return [
            Command(name, self.inputs, self.scratch / "out" / name)
            for name in (COMMANDS if self.every else QUICK)
        ]

    def generator(self, kind: str) -> np.random.Generator:
        """Each kind draws for itself."""
        return np.random.default_rng([self.seed, *kind.encode()])


def _signal(name: str, ground: Ground) -> Iterator[Try]:
    runs = (
        ground.plain_runs if name == "SIGINT" else ground.runs
    )  # which the command itself answers
    yield from processes.stopped(runs, name, ground.tries, ground.generator(name))


def _each(
    tried: Callable[[Command, int, int], Iterator[Try]], ground: Ground, step: int = 1
) -> Iterator[Try]:
    """The tries on each command from a random beginning, every so many; or one of them."""
    generator = ground.generator("each")
    for command in ground.commands:
        each = EVERY.get(command.name, 1) * step
        first = int(generator.integers(1, 1 + (each if ground.every else 3)))
        yield from islice(tried(command, first, each), None if ground.every else 1)


def _short_files(ground: Ground) -> Iterator[Try]:
    for command in ground.commands:
        yield from disk.short_files(command, disk.SIZES if ground.every else disk.SIZES[2:3])


def _memory(ground: Ground) -> Iterator[Try]:
    for name in ("run", "simulate", "reconstruct", "report") if ground.every else ("reconstruct",):
        out = ground.scratch / f"memory-{name}"
        limits_mb = LIMITS_MB if ground.every else LIMITS_MB[1::6]
        yield from processes.short_of_memory(
            COMMANDS[name].format(i=ground.inputs, o=out), out, limits_mb
        )


def _unwritable(ground: Ground) -> Iterator[Try]:
    for name in ("run", "reconstruct", "report") if ground.every else ("reconstruct",):
        out, places = ground.scratch / f"places-{name}", ground.scratch / f"places-of-{name}"
        tries = processes.unwritable(COMMANDS[name].format(i=ground.inputs, o=out), out, places)
        yield from tries if ground.every else islice(tries, 2)


def _clocks(ground: Ground) -> Iterator[Try]:
    for command in ground.commands:
        yield from surroundings.clocks(command, 2 if ground.every else 1)


def _edits(ground: Ground) -> Iterator[Try]:
    for name in ("run", "simulate", "tradeoff") if ground.every else ("simulate",):
        yield from surroundings.silent_edits(
            Command(name, ground.inputs, ground.scratch / "out" / name)
        )


def _at_once(ground: Ground) -> Iterator[Try]:
    yield from together.at_once(ground.runs, ground.tries, ground.generator("at once"))


def _cluster(ground: Ground) -> Iterator[Try]:
    bench, generator = several(write_bench(ground.scratch / "balls")), ground.generator("cluster")
    for number in range(max(ground.tries // 10, 1)):
        yield together.scheduler_lost(bench, ground.scratch / f"lost{number}", generator)
    yield together.other_version(bench, ground.scratch / "other")


KINDS: dict[str, Callable[[Ground], Iterator[Try]]] = {
    **{f"signal {name}": partial(_signal, name) for name in processes.SIGNALS},
    "files": partial(_each, lambda command, *which: disk.refused_writes(command, False, *which)),
    "renames": partial(_each, lambda command, *which: disk.refused_writes(command, True, *which)),
    "short files": _short_files,
    "outputs": lambda ground: disk.full_outputs(ground.inputs),
    "memory": _memory,
    "unwritable": _unwritable,
    "outputs vanish": partial(
        _each, lambda command, *which: surroundings.vanishing(command, False, *which), step=5
    ),
    "inputs vanish": partial(
        _each, lambda command, *which: surroundings.vanishing(command, True, *which)
    ),
    "clocks": _clocks,
    "edits": _edits,
    "at once": _at_once,
    "cluster": _cluster,
}
