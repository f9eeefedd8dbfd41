"""`handbench validate`: what is wrong with inputs, before hours are spent."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Every problem of every input, with its file and line; exit code 2 if there is one."""
    from handbench.bench.validation.validate import show

    show(options.inputs)
