"""`handbench report`: what there is to read of results."""

from __future__ import annotations

import argparse
from pathlib import Path

from radar.support.errors import HandbenchError

HELP = "result folder → tables, figures, HTML"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument("results", type=Path, metavar="DIR")
    command.add_argument("-o", "--out", required=True, type=Path, metavar="REPORT", help="report folder, renewed")
    command.add_argument(
        "--tradeoff", type=Path, metavar="DIR2", help="show this trade-off too (default: DIR/tradeoff)"
    )


def run(options: argparse.Namespace) -> None:
    """Result folder → report."""
    from reports.page.html import build

    if options.out.exists() and any(options.out.iterdir()) and not (options.out / "index.html").exists():
        raise HandbenchError(f"{options.out}: holds files but no index.html, so it is no report; choose another -o")
    print(f"report: {build(options.results, options.out, options.tradeoff)}")
