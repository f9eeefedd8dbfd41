"""`handbench import`: convert data of other programs and sensors to a capture folder."""

import argparse
from typing import Any

from handbench.cli.options import free_folder, set_values
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Convert a data set in another format to a capture folder, and write it (-o).
    Prints warnings of what is likely to be wrong with it."""
    from handbench.bench.datasets.dataset import IMPORTED, import_capture, open_capture
    from handbench.bench.validation.checks import CHANNELS, warnings_of

    settings: dict[str, Any] = {}
    set_values(settings, options.settings, "parameter=S11")
    free_folder(options.out, options.overwrite, IMPORTED)
    import_capture(options.dataset, options.source, options.out, **settings)
    for warning in warnings_of(open_capture(options.out).echoes(), CHANNELS):
        say(f"{options.out}: {warning}")
    say(f"the capture is in {options.out}")
