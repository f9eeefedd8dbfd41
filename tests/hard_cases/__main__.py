"""Run the hard cases on this machine and print their table: python -m tests.hard_cases [GROUP ...]

Where there is a CUDA device, the groups that image run once more on it, with a table of its own;
HANDBENCH_DEVICE chooses one device. The exit code is 1 where a case fails.
"""

import argparse
import os
import subprocess
import sys
from importlib import import_module

import numpy as np

from handbench.radar.imaging.device import SETTING, describe
from handbench.support.progress import track
from tests.hard_cases.cases import HardCase, Worst
from tests.hard_cases.table import markdown
from tests.radar.imaging.cupy_stand_in import has_gpu

GROUPS = ("phase", "data", "geometry", "smoothing", "registration", "meshes", "statistics")
IMAGING = ("phase", "data", "geometry")
COLUMNS = ("group", "case", "kind", "bound", "worst", "unit", "where", "verdict")


def cases(group: str) -> list[HardCase]:
    """The cases of a group, in the order of its module."""
    tests = vars(import_module(f"tests.hard_cases.test_{group}_cases")).values()
    return [test.case for test in tests if isinstance(getattr(test, "case", None), HardCase)]


def row(group: str, case: HardCase) -> tuple[str | float, ...]:
    """The case's line of the table. An exception is a failure of the case, not of the run."""
    try:
        worst = case.worst()
    except Exception as error:
        worst = Worst(np.inf, f"{type(error).__name__}: {error}")
    verdict = "flagged" if worst.flagged else "fails" if worst.value > case.bound else "holds"
    where = worst.at
    if case.kind == "refusal" and verdict == "holds":
        verdict, where = "refused", "everywhere"
    return group, case.name, case.kind, case.bound, worst.value, case.unit, where, verdict


def main() -> int:
    """Run the cases of the groups that the command line names."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.hard_cases", description=__doc__.partition(":")[0]
    )
    parser.add_argument(
        "groups", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)} (default: all)"
    )
    groups = parser.parse_args().groups or GROUPS
    if unknown := set(groups) - set(GROUPS):
        parser.error(f"unknown group {', '.join(sorted(unknown))}; expected {', '.join(GROUPS)}")
    chosen = [(group, case) for group in groups for case in cases(group)]
    rows = tuple(row(*one) for one in track(chosen, "hard cases"))
    verdicts = [line[-1] for line in rows]
    counted = ", ".join(
        f"{verdicts.count(name)} {name}" for name in ("holds", "refused", "flagged", "fails")
    )
    print(markdown(COLUMNS, rows))
    print(f"{len(rows)} hard cases, imaged on {describe()}: {counted}", flush=True)
    failed = "fails" in verdicts
    again = [group for group in groups if group in IMAGING]
    if again and not os.environ.get(SETTING) and has_gpu():
        command = [sys.executable, "-m", "tests.hard_cases", *again]
        failed |= subprocess.run(command, env={**os.environ, SETTING: "cuda"}).returncode != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
