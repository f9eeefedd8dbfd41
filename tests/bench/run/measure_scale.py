"""A thousand captures × nine methods and their report from depth maps that are kept: time and
memory.

    python -m tests.bench.run.measure_scale [--captures 100 300 1000] [--hands 4] -o FOLDER

A few simulated hands are imaged by the product (FOLDER/first, kept). Each is copied under further
names, with the folders of its stages `inspect` and `reconstruct` under the keys that the product
gives to the copies, so that of `handbench run` opening, hashing, scoring and the table are left, on
a Dask scheduler with two workers, and then `handbench report`. Processor time and peak memory are
of the process that runs the command, with its children.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from shutil import copytree

import tomlkit

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import DESCRIPTION, save_capture_file
from handbench.bench.run import jobs, runner
from handbench.bench.run.benchmark_file import BenchFile, MethodEntry, load_benchmark
from handbench.bench.run.outcome import RunCapture
from handbench.bench.run.simulate_stage import CAPTURE
from handbench.support.folder import MARKER, WORK
from handbench.support.store import Stage


def first_hands(folder: Path, count: int) -> tuple[BenchFile, list[RunCapture]]:
    """The first hands of the embedded benchmark `hands` by its methods and one more; kept once they
    have been run."""
    bench, base = load_benchmark("hands")
    methods = *bench.method, MethodEntry(id="3fsk-offaxis")
    bench = bench.model_copy(update={"capture": bench.capture[:count], "method": methods})
    runner.run(bench, base, folder)
    stages = [jobs.opening(bench, base, source, frames=1, photos=True) for source in bench.capture]
    return bench, [opened(stage.folder(folder / WORK) / CAPTURE, stage.key) for stage in stages]


def opened(place: Path, key: str) -> RunCapture:
    """A capture of a run."""
    return RunCapture(place, key, open_capture(place).about)


def kept(bench: BenchFile, capture: RunCapture) -> list[Stage]:
    """The stages of a capture that a run of the copies finds done."""
    images = [jobs.imaging(bench, Path(), capture, entry) for entry in bench.method]
    return [jobs.inspection(capture), *(stage for stages in images for stage in stages)]


def copies(
    bench: BenchFile, hands: list[RunCapture], first: Path, folder: Path, count: int
) -> Path:
    """Write a benchmark of so many copies, whose files are those of the hands, and of a run that
    has imaged them."""
    work, names = folder / "out" / WORK, [f"hand{number:04d}" for number in range(count)]
    work.mkdir(parents=True, exist_ok=True)
    (folder / "out" / MARKER).touch()
    captures = [{"path": f"captures/{name}"} for name in names]
    methods = [{"id": entry.id} for entry in bench.method]
    content = {"version": 1, "name": "scale", "capture": captures, "method": methods}
    copied = BenchFile.model_validate(content)
    for number, name in enumerate(names):
        hand, place = hands[number % len(hands)], folder / "captures" / name
        if not place.exists():
            copytree(hand.folder, place, copy_function=os.link)
            (place / DESCRIPTION).unlink()
            save_capture_file(place, hand.about.model_copy(update={"name": name}))
        mine = kept(copied, opened(place, open_capture(place).key(1)))
        for source, stage in zip(kept(bench, hand), mine, strict=True):
            if not stage.folder(work).exists():
                copytree(source.folder(first / WORK), stage.folder(work), copy_function=os.link)
    file = folder / "bench.toml"
    file.write_text(tomlkit.dumps(content), encoding="utf-8")
    return file


def measure(captures: int, name: str, *words: str) -> None:
    """Carry out a command and print what it took."""
    start_s = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "handbench.cli.main", name, *words])
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall_s, cpu_s = time.perf_counter() - start_s, used.ru_utime + used.ru_stime
    print(
        f"{captures} captures, {name}: {wall_s:.0f} s, {cpu_s:.0f} CPU s, "
        f"{used.ru_maxrss / 1e3:.0f} MB, "
        f"load {os.getloadavg()[0]:.1f}, exit code {process.returncode}",
        flush=True,
    )


def main() -> None:
    """Measure each number of captures."""
    from distributed import LocalCluster

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--captures", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--hands", type=int, default=4, help="that differ (default 4)")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FOLDER")
    options = parser.parse_args()
    out = options.out.resolve()
    bench, hands = first_hands(out / "first", options.hands)
    for count in options.captures:
        folder = out / f"of{count}"
        file, result = str(copies(bench, hands, out / "first", folder, count)), str(folder / "out")
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            measure(count, "run", file, "-o", result, "--scheduler", cluster.scheduler_address)
        measure(count, "report", result, "-o", str(folder / "report"))


if __name__ == "__main__":
    main()
