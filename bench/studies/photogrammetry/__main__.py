"""python -m bench.studies.photogrammetry bars|sweep -o DIR: rendered hands, photographed, reconstructed, against the
truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.studies.photogrammetry.cases import bars, sweep
from bench.studies.photogrammetry.page import markdown, write
from bench.studies.photogrammetry.run import run
from radar.support.progress import track
from radar.warmup import compile_kernels


def main() -> None:
    """Measure, print the table and write it with its figure."""
    parser = argparse.ArgumentParser(prog="python -m bench.studies.photogrammetry", description=__doc__)
    parser.add_argument("what", choices=("bars", "sweep"), help="what a ground truth is held to, or its price in time")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/photogrammetry"), metavar="DIR")
    parser.add_argument("--poses", default="C,Y", help="letters, separated by commas; sweep takes the first")
    options = parser.parse_args()
    poses = tuple(options.poses.split(","))
    cases = list(bars(poses) if options.what == "bars" else sweep(poses[0]))
    compile_kernels()
    rows = [run(case, options.out / "work") for case in track(cases, "photogrammetry")]
    write(rows, options.out, options.what)
    print(markdown(rows))


if __name__ == "__main__":
    main()
