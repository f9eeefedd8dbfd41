"""`handbench export`: captures in another data set's layout."""

import argparse

from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Captures → another data set's layout."""
    from handbench.bench.datasets.maroon_export import export_maroon

    for capture in options.captures:
        how = {"exact": options.exact, "mirrored": not options.plain_frame, "kinect": options.kinect}
        say(f"capture: {export_maroon(capture, options.out, options.overwrite, **how)}")
