"""Studies as scripts: their common options, and the files that they write."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from handbench.radar.imaging.device import use_device
from handbench.support.errors import HandbenchError
from tests.bench.studies.study import Study, run


def measured(
    parser: argparse.ArgumentParser,
    study: Callable[..., Study | Sequence[Study]],
    name: str,
    check: Callable[[dict[str, pd.DataFrame]], None] = lambda frames: None,
) -> None:
    """Parse the command line, measure, write the files into -o (default runs/NAME), and print the
    tables. The parser's options are the arguments of `study`, which may give several, after the
    folder for its work; `check` raises HandbenchError where figures, the tables by name, are not
    good enough. Known errors and failed cases are one line and exit code 2."""
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("runs") / name, help=f"default runs/{name}"
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="the cases whose name holds TEXT"
    )
    given = vars(parser.parse_args())
    out, only = given.pop("out"), given.pop("only")
    work = (out.parent if out.suffix == ".json" else out) / "work"
    failed: list[str] = []
    try:
        with use_device(given.get("device")):
            made = study(work, **given)
            command = f"{parser.prog} {shlex.join(sys.argv[1:])}".strip()
            for part in [made] if isinstance(made, Study) else made:
                found = run(part, out, command, only)
                print(found.markdown())
                check(found.frames)
                failed += (
                    [f"{len(found.failures)} of {len(part.cases)} cases failed"]
                    if found.failures
                    else []
                )
        if failed:
            raise HandbenchError("; ".join(failed))
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
