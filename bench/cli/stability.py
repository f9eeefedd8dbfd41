"""`handbench stability`: the catalogue of hard cases, measured."""

from __future__ import annotations

import argparse

from bench.cli.options import add_out
from radar.support.errors import HandbenchError

HELP = "hard cases: what could blow up, its bound, and the measured figure"
GROUPS = "phase, data, geometry, smoothing, registration, meshes, statistics"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("--groups", metavar="A,B", help=f"of {GROUPS} (default: all)")
    command.add_argument("--seed", type=int, default=0, help="of the random scenes (default 0)")
    command.add_argument("--scenes", type=int, default=10_000, help="random hard scenes (default 10000; 0: none)")
    add_out(command, "DIR", "folder for stability.csv and .json, as a result folder", required=False)


def run(options: argparse.Namespace) -> None:
    """Measure, show, write; a case that fails ends with exit code 2."""
    from bench.cli.options import free
    from bench.studies.stability.measure import run_stability, show

    if options.out is not None:
        free(options.out / "stability.csv", options.overwrite)
    facts, cases = run_stability(options.groups, options.seed, options.scenes, options.out)
    show(facts, cases)
    failed = cases.case[cases.verdict == "fails"]
    if len(failed):
        raise HandbenchError(f"stability: {len(failed)} of {len(cases)} cases fail: {'; '.join(failed)}")
