"""`handbench export`: captures in another data set's layout."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.cli.options import add_out
from radar.support.progress import say

HELP = "captures → another data set's layout"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("dataset", choices=("maroon",))
    command.add_argument("captures", nargs="+", type=Path, metavar="CAPTURE")
    add_out(command, "ROOT", "the data set's root; ROOT/NAME/CENTIMETRES is written")


def run(options: argparse.Namespace) -> None:
    """Captures → another data set's layout."""
    from bench.datasets.maroon_export import export_maroon

    for capture in options.captures:
        say(f"capture: {export_maroon(capture, options.out, options.overwrite)}")
