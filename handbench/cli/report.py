"""`handbench report`: write the report of one or several results."""

import argparse

from handbench.cli.options import free_folder
from handbench.support.progress import print_lines


def run(options: argparse.Namespace) -> None:
    """Write the report of one result folder, or of several with one page that shows all of their
    methods. Prints the path of the first page."""
    from handbench.reports.page.html import build, build_several

    free_folder(options.out, True, ("index.html", "*"))
    if len(options.results) == 1:
        first = build(options.results[0], options.out)
    else:
        first = build_several(options.results, options.out)
    print_lines(f"report: {first}")
