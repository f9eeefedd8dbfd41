"""`handbench compare`: the differences between the figures of two results."""

import argparse
import json

from handbench.cli.options import free


def run(options: argparse.Namespace) -> None:
    """Compare two result folders and print the differences, as tables or as JSON; with -o, also
    write them into a folder."""
    from handbench.bench.results.compare_results import compare_results
    from handbench.bench.results.result_folder import load
    from handbench.reports.tables.comparison import show, write

    if options.out is not None:
        free(options.out / "compare.json", options.overwrite)
    compared = compare_results(load(options.a), load(options.b))
    if options.json:
        print(json.dumps(compared.content(), indent=2))
    else:
        show(compared)
    if options.out is not None:
        write(compared, options.out)
