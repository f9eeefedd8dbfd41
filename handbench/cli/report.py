"""`handbench report`: write the report of one or several results."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Write the report of one result folder, or for several folders a ranking of their methods and
    the report of each.
    Prints the path of the first page."""
    from handbench.bench.results import load
    from handbench.bench.results.ranking import rank_methods
    from handbench.reports.page import html, leaderboard

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
        print(f"report: {html.build(options.results[0], options.out, options.tradeoff)}")
        return
    if options.tradeoff is not None:
        raise HandbenchError(
            "--tradeoff: works with one result folder only; leave --tradeoff out, or report each "
            "result separately"
        )
    results = [load(folder) for folder in options.results]
    print(f"report: {leaderboard.build(results, *rank_methods(results), options.out)}")
