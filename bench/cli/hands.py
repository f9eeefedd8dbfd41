"""`handbench hands`: a set of captures to run methods on, public or hidden."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Write the set, or what is missing of it."""
    from bench.submissions.sets import BENCH, Part, find_set, write_set

    chosen, base = find_set(options.set)
    part: Part = "hidden" if options.reveal else options.part
    names = write_set(options.out, chosen, base, part, options.seed, options.reveal, options.limit)
    print(f"{chosen.name}, {part} part: {len(names)} captures; handbench run {options.out / BENCH} -o DIR")
