"""`handbench validate`: what is wrong with inputs, before hours are spent."""

from __future__ import annotations

import argparse

HELP = "check benchmarks, scenes and captures before hours are spent"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("inputs", nargs="+", metavar="INPUT", help="benchmark or scene file, or capture folder")


def run(options: argparse.Namespace) -> None:
    """Every problem of every input, with its file and line; exit code 2 if there is one."""
    from bench.validation.validate import show

    show(options.inputs)
