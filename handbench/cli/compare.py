"""`handbench compare`: the differences between the figures of two results."""

import argparse

from handbench.cli.options import free_folder
from handbench.support.progress import print_json


def run(options: argparse.Namespace) -> None:
    """Compare two result folders and print the differences, as tables or as JSON; with -o, also
    write them into a folder."""
    from handbench.bench.results.compare_results import compare_results
    from handbench.bench.results.result_folder import load
    from handbench.reports.tables.comparison import WRITTEN, show, write

    if options.out is not None:
        free_folder(options.out, options.overwrite, WRITTEN)
    compared = compare_results(load(options.a), load(options.b))
    if options.json:
        print_json(compared.content())
    else:
        show(compared, options.metric, options.method)
    if options.out is not None:
        write(compared, options.out)
