"""`handbench stability`: the catalogue of hard cases, measured."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Measure, show, write; a case that fails ends with exit code 2."""
    from handbench.bench.studies.stability.measure import run_stability, show
    from handbench.cli.options import free

    if options.out is not None:
        free(options.out / "stability.csv", options.overwrite)
    facts, cases = run_stability(options.groups, options.out)
    show(facts, cases)
    failed = cases.case[cases.verdict == "fails"]
    if len(failed):
        raise HandbenchError(f"stability: {len(failed)} of {len(cases)} cases fail: {'; '.join(failed)}")
