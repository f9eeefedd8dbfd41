"""`handbench leaderboard`: a result's methods, own and submitted, ranked."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Result folder → leaderboard with its report."""
    from handbench.reports.page.leaderboard import build

    if options.out.exists() and any(options.out.iterdir()) and not (options.out / "leaderboard.md").exists():
        raise HandbenchError(f"{options.out}: holds files but no leaderboard.md; choose another -o")
    print(f"leaderboard: {build(options.results, options.out, options.tradeoff, options.at_mm)}")
