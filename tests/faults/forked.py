"""`python -m tests.faults.forked BENCH photographs|plain`: a process that has imported all that a
run needs, and does runs in forks of itself, so that a signal meets their work rather than their
imports.

Reads lines `OUT<tab>FILE<tab>STAGE`; answers each with the number of the process, then with its
exit code. FILE takes its stderr; after the first STAGE, if there is one, a run with photographs
ends as if it were killed.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from importlib import import_module

from handbench.bench.run import reconstruct_stage
from handbench.cli.main import main
from handbench.support.code_hash import key_of
from handbench.support.rays import load_open3d
from tests.bench.run.photographed import RUN

NEEDED = (
    "handbench.cli.run",
    "handbench.bench.run.runner",
    "handbench.bench.run.simulate_stage",
    "handbench.bench.run.reconstruct_stage",
    "handbench.bench.run.scoring",
    "handbench.bench.run.repeat_stage",
    "handbench.bench.run.calibrate_stage",
    "handbench.bench.scenes.echoes",
    "handbench.bench.scenes.photographs",
    "handbench.groundtruth.sparse_stage",
    "handbench.groundtruth.dense_stage",
    "handbench.groundtruth.mesh_stage",
    "handbench.radar.warmup",
    "handbench.reports.tables.result_tables",
)


def serve() -> None:
    """Answer lines until there are no more."""
    bench, photographs = sys.argv[1], sys.argv[2] == "photographs"
    load_open3d()
    for module in NEEDED:
        import_module(module)
        if module.startswith("handbench.bench.run.") and module != "handbench.bench.run.runner":
            key_of(module)
    reconstruct_stage.SETTLE_S = 0.0  # nobody reads the times
    scope: dict[str, object] = {}
    if photographs:
        sys.argv = ["run", bench, "", "never"]
        exec(RUN.rpartition("sys.exit(")[0], scope)
    for line in sys.stdin:
        out, stderr, scope["last"] = line.rstrip("\n").split("\t")
        child = os.fork()
        if child == 0:
            _run(bench, out, stderr)
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _run(bench: str, out: str, stderr: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.dup2(os.open(stderr, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
    os.dup2(os.open(os.devnull, os.O_RDWR), 1)
    code = 1
    try:
        code = main(["run", bench, "-o", out])
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    serve()
