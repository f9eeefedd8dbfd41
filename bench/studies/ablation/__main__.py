"""python -m bench.studies.ablation -o docs: every effect on simulated hands."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.studies.ablation.measure import ablate
from bench.studies.ablation.page import markdown, write


def main() -> None:
    """Measure, print the table and write it with its figure."""
    parser = argparse.ArgumentParser(prog="python -m bench.studies.ablation", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/ablation"), metavar="DIR")
    parser.add_argument("--poses", default="B,F,U", help="letters, separated by commas (default: B,F,U)")
    parser.add_argument("--frames", type=int, default=10, help="repeats for the precision (default 10)")
    options = parser.parse_args()
    rows = ablate(tuple(options.poses.split(",")), options.frames)
    write(rows, options.out)
    print(markdown(rows))


if __name__ == "__main__":
    main()
