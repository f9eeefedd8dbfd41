"""`handbench submit`: the depth maps of a foreign method, made by its own command, or checked."""

import argparse
import shutil

from handbench.cli.options import free_folder
from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Run the command on every capture of a benchmark, or check a folder; exit code 2 if it cannot be scored."""
    from handbench.bench.run import submitting
    from handbench.bench.run.benchmark_file import load_benchmark
    from handbench.bench.submissions import foreign
    from handbench.bench.submissions.submission import DESCRIPTION, Submission
    from handbench.radar.methods.registry import methods
    from handbench.support.config import parse
    from handbench.support.cost import calibrated_machine

    bench, base = load_benchmark(options.bench)
    if options.check is not None:
        submitting.require_complete(options.check, bench, base)
        print(f"{options.check}: can be scored: handbench evaluate-submission {options.check} {options.bench} -o DIR")
        return
    if options.line is None or options.name is None or options.out is None:
        raise HandbenchError("--command, --name, --out: one is missing; expected these three, or --check SUBMISSION")
    foreign.parts(options.line)
    if options.name in {known.id for known in methods()} or not options.limit_s > 0 or options.limit_mb < 0:
        raise HandbenchError("--name, --limit-s, --limit-mb: expected a name of your own, and limits above 0")
    given = {
        "method": options.name,
        "benchmark": bench.name,
        "timing": "depth map" if options.own_seconds else "command",
        "command": options.line,
        "machine": calibrated_machine(),
    }
    about = parse(Submission, given, "--name")
    if options.overwrite and options.out.exists():
        free_folder(options.out, True, DESCRIPTION)
        shutil.rmtree(options.out)
    rows = submitting.make(options.out, about, bench, base, options.limit_s, options.limit_mb * 2**20)
    print(f"submission: {options.out}, {len(rows)} captures")
