"""`python -m tests.mutation`: random mutants of each package, tried in a copy of the repository."""

from __future__ import annotations

import argparse
import ctypes
import importlib
import json
import os
import signal
import sys
import time
import tomllib
from pathlib import Path

from scipy.stats import binomtest

from tests.mutation.mutants import mutants
from tests.mutation.trial import Trials

PACKAGES = ("groundtruth", "bench/evaluation", "calibration", "radar")
LIBRARIES = (
    "numpy",
    "scipy.optimize",
    "scipy.ndimage",
    "scipy.spatial",
    "numba",
    "h5py",
    "pandas",
    "pydantic",
    "cv2",
    "open3d",
    "pycolmap",
    "PIL.Image",
    "skimage",
    "hypothesis",
    "psutil",
    "tomlkit",
)
EXPLAINED = Path(__file__).with_name("explained.toml")


def main() -> int:
    """Print each mutant's end and the packages' scores."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=40, help="mutants of each package")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--package", action="append", default=[], choices=PACKAGES)
    parser.add_argument("--only", action="append", default=[], help="mutants whose name holds this")
    parser.add_argument(
        "--skip", type=int, default=0, help="of each package's mutants, already tried"
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="of all packages together")
    parser.add_argument(
        "--tree",
        type=Path,
        required=True,
        help="copy of the repository, in which files are changed",
    )
    parser.add_argument(
        "--map", type=Path, required=True, help="of tests.mutation.contexts, made in the copy"
    )
    parser.add_argument("-o", dest="out", type=Path, help="JSON of all mutants")
    options = parser.parse_args()
    load()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that the changed file is put back
    trials, rows = Trials(options.tree.resolve(), options.map), []
    known = tomllib.loads(EXPLAINED.read_text(encoding="utf-8"))["mutant"]
    explained = {(mutant["file"], mutant["changed"]): mutant["reason"] for mutant in known}
    end = time.monotonic() + 60 * options.minutes
    drawn = {
        p: mutants(trials.tree, p, options.sample, options.seed)
        for p in options.package or PACKAGES
    }
    for number in range(
        options.skip, options.sample
    ):  # in turns, so that all packages get equal samples
        for package, drawn_here in drawn.items():
            if number >= len(drawn_here) or time.monotonic() > end:
                continue
            mutant = drawn_here[number]
            if options.only and not any(part in mutant.name for part in options.only):
                continue
            outcome = trials.outcome(mutant)
            changed = mutant.code(trials.tree).splitlines()[mutant.line - 1].strip()
            reason = explained.get((mutant.file, changed), "")
            row = {
                "package": package,
                "mutant": mutant.name,
                "changed": changed,
                "reason": reason,
                **vars(outcome),
            }
            rows.append(row)
            print(
                f"{outcome.verdict:9} {outcome.seconds:5.1f} s {outcome.tests:4} tests  "
                f"{mutant.name}  {changed}",
                flush=True,
            )
    for package in options.package or PACKAGES:
        print(score(package, [row for row in rows if row["package"] == package]))
    if options.out:
        options.out.write_text(json.dumps(rows, indent=1, ensure_ascii=False), encoding="utf-8")
    return 0


def load() -> None:
    """Import libraries, and nothing that is mutated: the trials are forks of this process."""
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"  # in the tests' processes too
    sys.dont_write_bytecode = True
    usb = importlib.import_module("libusb_package")
    ctypes.CDLL(str(usb.get_library_path()), mode=ctypes.RTLD_GLOBAL)  # for open3d
    for library in LIBRARIES:
        importlib.import_module(library)
    if mutated := sorted(name for name in sys.modules if name.startswith("handbench.")):
        raise RuntimeError(f"{mutated} are imported before they are mutated")


def score(package: str, rows: list[dict]) -> str:
    """The share of killed mutants among those that are not explained, with its Wilson interval."""
    counted = [row for row in rows if row["verdict"] != "survived" or not row["reason"]]
    killed = sum(row["verdict"] != "survived" for row in counted)
    if not counted:
        return f"{package}: no mutants"
    low, high = binomtest(killed, len(counted)).proportion_ci(method="wilson")
    timed = sum(row["verdict"] == "timed out" for row in counted)
    return (
        f"{package}: {killed} of {len(counted)} killed, {100 * killed / len(counted):.1f} % "
        f"[{100 * low:.1f}, {100 * high:.1f}], {timed} by time; {len(rows) - len(counted)} "
        "explained"
    )


if __name__ == "__main__":
    sys.exit(main())
