"""`handbench report`: write the report of one or several results."""

import argparse

from handbench.support.errors import HandbenchError
from handbench.support.progress import print_lines


def run(options: argparse.Namespace) -> None:
    """Write the report of one result folder, or of several with one page that shows all of their
    methods. Prints the path of the first page."""
    from handbench.reports.page import html, several

    if (
        options.out.exists()
        and any(options.out.iterdir())
        and not (options.out / "index.html").exists()
    ):
        raise HandbenchError(
            f"{options.out}: is a folder with files but without index.html, so it is not a report "
            "and is not overwritten; choose another folder for -o"
        )
    if len(options.results) == 1:
        first = html.build(options.results[0], options.out)
    else:
        first = several.build(options.results, options.out)
    print_lines(f"report: {first}")
