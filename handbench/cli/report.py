"""`handbench report`: write the report of one or several results."""

import argparse

from handbench.support.errors import HandbenchError


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
        print(f"report: {html.build(options.results[0], options.out)}")
        return
    print(f"report: {several.build(options.results, options.out)}")
