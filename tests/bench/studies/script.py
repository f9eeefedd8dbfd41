"""Studies that lie with the tests, as scripts: their options, files and tables are those of `handbench study`."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from bench.studies.study import Study, run
from radar.imaging.device import use_device
from radar.support.errors import HandbenchError


def measured(
    parser: argparse.ArgumentParser,
    study: Callable[..., Study],
    name: str,
    check: Callable[[dict[str, pd.DataFrame]], None] = lambda frames: None,
) -> None:
    """Parse the command line, measure, write the files into -o (default runs/NAME), and print the tables. The parser's
    options are the arguments of `study` after the folder for its work; `check` raises HandbenchError where figures, the
    tables by name, are not good enough. Known errors and failed cases are one line and exit code 2."""
    parser.add_argument("-o", "--out", type=Path, default=Path("runs") / name, help=f"default runs/{name}")
    parser.add_argument("--only", default="", metavar="TEXT", help="the cases whose name holds TEXT")
    given = vars(parser.parse_args())
    out, only = given.pop("out"), given.pop("only")
    work = (out.parent if out.suffix == ".json" else out) / "work"
    try:
        with use_device(given.get("device")):
            found = run(study(work, **given), out, f"{parser.prog} {shlex.join(sys.argv[1:])}".strip(), only)
        print(found.markdown())
        check(found.frames)
        if found.failures:
            raise HandbenchError(f"{len(found.failures)} of {len(found.study.cases)} cases failed")
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
