"""`handbench inspect`: find problems in files and captures, and say how to mend them."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Check files and captures before a run, and print problems and warnings, each with a remedy.
    The exit code is 2 if a run would fail, and 0 if there are only warnings."""
    from handbench.bench.validation.inspection import show

    show([str(path) for path in options.paths])
