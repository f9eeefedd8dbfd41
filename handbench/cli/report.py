"""`handbench report`: what there is to read of results."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Result folder → report."""
    from handbench.reports.page.html import build

    if options.out.exists() and any(options.out.iterdir()) and not (options.out / "index.html").exists():
        raise HandbenchError(f"{options.out}: holds files but no index.html, so it is no report; choose another -o")
    print(f"report: {build(options.results, options.out, options.tradeoff)}")
