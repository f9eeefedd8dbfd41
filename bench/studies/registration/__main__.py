"""python -m bench.studies.registration full|faults -o DIR: the calibration target in random placements, against the
truth."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from bench.studies.registration.cases import FAULTS
from bench.studies.registration.page import markdown, write
from bench.studies.registration.run import Trial, photographed, sampled
from radar.support.progress import track
from radar.warmup import compile_kernels


def trials(what: str, count: int, work: Path) -> Iterator[Trial]:
    """`full`: photographs and echoes simulated. `faults`: echoes simulated, clouds drawn, something
    wrong with every second."""
    faults = [one for fault in FAULTS if fault != "none" for one in ("none", fault)]
    for number in track(range(count), f"registration, {what}"):
        yield photographed(number, work) if what == "full" else sampled(number, work, faults[number % len(faults)])


def main() -> None:
    """Measure, print the table and write it with its figure."""
    parser = argparse.ArgumentParser(prog="python -m bench.studies.registration", description=__doc__)
    parser.add_argument("what", choices=("full", "faults"), help="photographs too, or many trials with faults")
    parser.add_argument("-n", "--trials", type=int, help="default 20 and 200")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/registration"), metavar="DIR")
    options = parser.parse_args()
    compile_kernels()
    done = list(trials(options.what, options.trials or {"full": 20, "faults": 200}[options.what], options.out / "work"))
    write(done, options.out, options.what)
    print(markdown(done))


if __name__ == "__main__":
    main()
