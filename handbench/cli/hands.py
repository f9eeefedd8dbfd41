"""`handbench hands`: a set of captures to run methods on."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Write the set, or what is missing of it."""
    from handbench.bench.submissions.sets import BENCH, find_set, hidden, read_secret, write_set

    if options.truth and options.hidden is None:
        raise HandbenchError("--truth: adds the surfaces of a hidden part; name its secret, --hidden SECRET")
    chosen, base = find_set(options.set)
    if options.hidden is None:
        names = write_set(options.out, chosen, base, options.limit)
    else:
        secret = read_secret(options.hidden, options.out, options.truth)
        chosen = hidden(chosen, secret)
        names = write_set(options.out, chosen, base, options.limit, secret, options.truth)
    print(f"{chosen.name}: {len(names)} captures; handbench run {options.out / BENCH} -o DIR")
