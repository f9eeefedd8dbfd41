"""A thousand captures × nine methods and their report from depth maps that are kept: time and
memory of each process.

    python -m tests.bench.run.measure_scale [--captures 100 300 1000] [--hands 4] [--client] -o
    FOLDER

A few simulated hands are imaged by the product (FOLDER/first, kept). Each is copied under further
names, with the folders of its stages `inspect` and `reconstruct` under the keys that the product
gives to the copies, so that of `handbench run` opening, hashing, scoring and the table are left, on
a Dask scheduler with two workers, and then `handbench report`. Processor time is of the process and
its children; memory is resident, sampled. --client: to measure the client alone, workers link the
hands' scores instead of scoring each copy, and there is no report.
"""

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from shutil import copytree
from typing import Any
from unittest.mock import patch

import psutil
import tomlkit

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import DESCRIPTION, save_capture_file
from handbench.bench.evaluation.tables import Column
from handbench.bench.run import jobs, runner
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, load_benchmark
from handbench.bench.run.outcome import Capture
from handbench.bench.run.simulate_stage import CAPTURE
from handbench.support.folder import MARKER, WORK
from handbench.support.progress import say
from handbench.support.store import MANIFEST, STAMP, Stage, Stamp, cached
from handbench.bench.studies.study import Record, Table

SAMPLE_S = 0.2
MODULE = "tests.bench.run.measure_scale"
COLUMNS = (
    Column("captures", int, "of nine methods each", heading="captures", form="{}"),
    Column("what", str, "the command, or who helps it", heading="process"),
    Column("wall_s", float, "until it ended", heading="wall s", form="{:.0f}"),
    Column("cpu_s", float, "its own and its children's", heading="CPU s", form="{:.0f}"),
    Column("each_s", float, "a capture", heading="CPU s a capture", form="{:.3f}"),
    Column("peak_mb", float, "of the process alone", heading="peak MB", form="{:.0f}"),
    Column(
        "children_mb",
        float,
        "of the largest child",
        heading="its largest child's MB",
        form="{:.0f}",
    ),
    Column("load", float, "of the machine in the last minute", heading="load", form="{:.1f}"),
)


def first_hands(folder: Path, count: int) -> tuple[BenchFile, list[Capture]]:
    """The first hands of the embedded benchmark `hands` by its methods and one more; kept once they
    have been run."""
    bench, base = load_benchmark("hands")
    methods = *bench.method, MethodEntry(id="3fsk-offaxis")
    bench = bench.model_copy(update={"capture": bench.capture[:count], "method": methods})
    runner.run(bench, base, folder)
    stages = [jobs.opening(bench, base, source, frames=1, photos=True) for source in bench.capture]
    places = [(stage.folder(folder / WORK) / CAPTURE, stage.key) for stage in stages]
    return bench, [Capture(place, key, open_capture(place).about) for place, key in places]


def kept_stages(bench: BenchFile, capture: Capture) -> list[Stage]:
    """The stages of a capture that a run of the copies finds done."""
    return [
        jobs.inspection(capture),
        *(stage for entry in bench.method for stage in jobs.imaging(bench, Path(), capture, entry)),
    ]


def copies(bench: BenchFile, hands: list[Capture], first: Path, folder: Path, count: int) -> Path:
    """Write a benchmark of so many copies, whose files are those of the hands, and of a run that
    has imaged them."""
    work, names = folder / "out" / WORK, [f"hand{number:04d}" for number in range(count)]
    work.mkdir(parents=True, exist_ok=True)
    (folder / "out" / MARKER).touch()
    told = {
        "version": 1,
        "name": "scale",
        "capture": [{"path": f"captures/{name}"} for name in names],
    }
    told["method"] = [{"id": entry.id} for entry in bench.method]
    copied = BenchFile.model_validate(told)
    for number, name in enumerate(names):
        hand, place = hands[number % len(hands)], folder / "captures" / name
        if not place.exists():
            copytree(hand.folder, place, copy_function=os.link)
            (place / DESCRIPTION).unlink()
            save_capture_file(place, hand.about.model_copy(update={"name": name}))
        key = open_capture(place).key(1)
        mine = kept_stages(copied, Capture(place, key, open_capture(place).about))
        for source, stage in zip(kept_stages(bench, hand), mine, strict=True):
            if not stage.folder(work).exists():
                copytree(source.folder(first / WORK), stage.folder(work), copy_function=os.link)
    file = folder / "bench.toml"
    file.write_text(tomlkit.dumps(told), encoding="utf-8")
    return file


def linked(folder: Path, capture: str, **_: Any) -> None:
    """Fill the folder of the stage `score` of a copy with the files of its hand's."""
    place = Path(capture)
    scores = sorted((place.parents[2] / "first" / WORK).glob("score-*"))
    source = scores[int(place.name.removeprefix("hand")) % len(scores)]
    for file in (
        path for path in source.rglob("*") if path.is_file() and path.name not in (MANIFEST, STAMP)
    ):
        target = folder / file.relative_to(source)
        target.parent.mkdir(exist_ok=True)
        _, _, rest = file.name.partition("__")
        os.link(file, target.with_name(f"{place.name}__{rest}") if rest else target)


def linking(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """As `cached`, but scores are linked."""
    if stage.name == "score":
        object.__setattr__(stage, "function", linked)
    return cached(root, stage)


def client(bench: str, out: str, scheduler: str) -> None:
    """A run whose workers link scores."""
    found, base = load_benchmark(bench)
    with patch.object(runner, "cached", linking):
        runner.run(found, base, Path(out), scheduler=scheduler)


class Watched:
    """A process, its processor time with that of its children, and the peak of its memory and of a
    child's."""

    def __init__(self, name: str, command: list[str], log: Path) -> None:
        self.name, self.start, self.log = name, time.perf_counter(), log
        with log.open("w") as stream:
            self.process = subprocess.Popen(
                [sys.executable, *command], stdout=stream, stderr=stream
            )
        self.peak_mb, self.children_mb, self.cpu_s, self.wall_s = 0.0, 0.0, 0.0, 0.0
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def _watch(self) -> None:
        try:
            process, children_s = psutil.Process(self.process.pid), {}
            while self.process.poll() is None:
                self.peak_mb = max(self.peak_mb, process.memory_info().rss / 1e6)
                for child in process.children(recursive=True):
                    try:
                        self.children_mb = max(self.children_mb, child.memory_info().rss / 1e6)
                        children_s[child.pid] = sum(child.cpu_times()[:2])
                    except psutil.Error:  # it has ended meanwhile
                        pass
                self.cpu_s, self.wall_s = (
                    sum(process.cpu_times()[:2]) + sum(children_s.values()),
                    self._gone_s(),
                )
                time.sleep(SAMPLE_S)
        except psutil.Error:
            pass

    def _gone_s(self) -> float:
        return time.perf_counter() - self.start

    def ended(self) -> None:
        """Wait for it; its error is raised."""
        if self.process.wait():
            sys.exit(f"{self.name} failed: see {self.log}")
        self.thread.join()

    def stop(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        self.thread.join()

    def record(self, captures: int) -> Record:
        """A line of the table."""
        facts = {
            name: getattr(self, name) for name in ("wall_s", "cpu_s", "peak_mb", "children_mb")
        }
        return {
            "captures": captures,
            "what": self.name,
            **facts,
            "each_s": self.cpu_s / captures,
            "load": os.getloadavg()[0],
        }


def measured(bench: Path, captures: int, alone: bool) -> Iterable[Record]:
    """The run on a scheduler with two workers, and then the report; alone: of the client, without a
    report."""
    folder, out, scheduler = bench.parent, bench.parent / "out", bench.parent / "scheduler.json"
    scheduler.unlink(missing_ok=True)
    dask = "--scheduler-file", str(scheduler), "--host", "127.0.0.1", "--no-dashboard"
    helpers = [
        Watched(
            "scheduler",
            ["-m", "distributed.cli.dask_scheduler", "--port", "0", *dask],
            folder / "scheduler.log",
        )
    ]
    one = "-m", "distributed.cli.dask_worker", *dask, "--nthreads", "1", "--no-nanny"
    helpers += [Watched(f"worker {k}", list(one), folder / f"worker{k}.log") for k in "ab"]
    try:
        command = [
            "handbench.cli.main",
            "run",
            str(bench),
            "-o",
            str(out),
            "--scheduler",
            address(scheduler),
        ]
        if alone:
            main_of = (
                f"from {MODULE} import client; client({str(bench)!r}, {str(out)!r}, "
                f"{command[-1]!r})"
            )
        ran = Watched("run", ["-c", main_of] if alone else ["-m", *command], folder / "run.log")
        ran.ended()
    finally:
        for helper in helpers[::-1]:
            helper.stop()
    yield from (process.record(captures) for process in (ran, *helpers))
    if alone:
        return
    written = ["-m", "handbench.cli.main", "report", str(out), "-o", str(folder / "report")]
    report = Watched("report", written, folder / "report.log")
    report.ended()
    yield report.record(captures)


def address(scheduler: Path) -> str:
    """Of the scheduler, once two workers are there."""
    from distributed import Client

    while not scheduler.exists():
        time.sleep(0.1)
    with Client(scheduler_file=str(scheduler), set_as_default=False) as client:
        client.wait_for_workers(2, timeout=300)
        return client.scheduler.address


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--captures", type=int, nargs="+", default=[100, 300, 1000], help="default 100 300 1000"
    )
    parser.add_argument("--hands", type=int, default=4, help="that differ (default 4)")
    parser.add_argument(
        "--client", action="store_true", help="measure the client alone: scores are linked"
    )
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    options = parser.parse_args()
    out = options.out.resolve()
    bench, hands = first_hands(out / "first", options.hands)
    records: list[Record] = []
    for count in options.captures:
        file = copies(bench, hands, out / "first", out / f"of{count}", count)
        for record in measured(file, count, options.client):
            say(str(record))  # should a later one fail
            records.append(record)
    print(Table("rows", COLUMNS, records).markdown())


if __name__ == "__main__":
    main()
