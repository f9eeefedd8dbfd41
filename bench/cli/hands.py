"""`handbench hands`: a set of captures to run methods on."""

import argparse


def run(options: argparse.Namespace) -> None:
    """Write the set, or what is missing of it."""
    from bench.submissions.sets import BENCH, find_set, write_set

    chosen, base = find_set(options.set)
    names = write_set(options.out, chosen, base, options.limit)
    print(f"{chosen.name}: {len(names)} captures; handbench run {options.out / BENCH} -o DIR")
