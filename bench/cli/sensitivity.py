"""`handbench sensitivity`: what would have to be true for the paper's table."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Each factor by itself, then all jointly: the answer in words, and a page, a figure and tables of either part."""
    from bench.run.benchmark_file import load_benchmark
    from bench.studies.sensitivity.measure import Measurement
    from bench.studies.sensitivity.parts import PARTS
    from bench.studies.study import run as measure
    from radar.support.folder import claimed

    bench, base = load_benchmark(options.bench)
    with claimed(options.out) as work:
        measurement = Measurement(bench, base.resolve(), work)
        chosen = [options.parts] if options.parts else list(PARTS)
        part = f" --parts {options.parts}" if options.parts else ""
        command = f"handbench sensitivity {options.bench} -o {options.out}{part}"
        for name in chosen:
            found = measure(PARTS[name](measurement), options.out, command)
            print(found.markdown())
            print(f"sensitivity: {options.out / found.study.name}.md")
