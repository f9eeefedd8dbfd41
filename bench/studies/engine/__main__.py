"""Measure, print the tables, write the rows and draw the picture.

    python -m bench.studies.engine -o runs/bench.json [--quick] [--full]

Seconds drift with the machine; ratio_to_exact, within one run, is what counts.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path


def main() -> None:
    """The command; heavy imports come late, since every measured process passes through here."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True, help="the JSON file; pictures go beside it")
    parser.add_argument("--quick", action="store_true", help="a small volume, in less than a minute: does it all run?")
    parser.add_argument("--full", action="store_true", help="measure the exact volume whole instead of extrapolating")
    arguments = parser.parse_args()

    from bench.studies.engine.picture import draw
    from bench.studies.engine.report import print_tables
    from bench.studies.engine.scope import QUICK, Scope
    from radar.support.files import write_json

    scope = QUICK if arguments.quick else Scope()
    result = measure(replace(scope, exact_planes=None) if arguments.full else scope)
    write_json(arguments.out, result)
    draw(result, arguments.out)
    print_tables(result)


def measure(scope) -> dict:  # type: ignore[no-untyped-def]
    """All sections: machine, load, rows, growth and bars, as the JSON file holds them."""
    from bench.studies.engine.accuracy import bars, compile_seconds, thread_differences
    from bench.studies.engine.frame_rows import frame_rows, simulation_rows
    from bench.studies.engine.growth import growth
    from bench.studies.engine.scope import Inputs
    from bench.studies.engine.volume_rows import volume_rows
    from radar.support.cost import machine
    from radar.support.progress import say
    from radar.support.store import versions
    from radar.warmup import compile_kernels

    start, load = time.perf_counter(), {"before": os.getloadavg()}
    say("compiling the kernels with an empty cache")
    compile_s = compile_seconds()
    compile_kernels()
    say("a hand and its echoes")
    inputs = Inputs(scope)
    rows = volume_rows(inputs) + frame_rows(inputs) + simulation_rows(inputs)
    grows = growth(inputs)
    say("one thread against all")
    checks = bars(rows, grows, thread_differences(inputs), compile_s)
    load["after"] = os.getloadavg()
    return {
        "machine": machine(),
        "versions": versions(),
        "load": load,
        "minutes": (time.perf_counter() - start) / 60,
        "rows": [row.as_dict() for row in rows],
        "growth": grows,
        "bars": checks,
    }


if __name__ == "__main__":
    main()
