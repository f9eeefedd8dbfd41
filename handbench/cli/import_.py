"""`handbench import`: convert data of other programs and sensors to a capture folder."""

import argparse
from typing import Any

from handbench.cli.options import free_folder, set_values
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Convert a data set in another format to a capture folder, and write it (-o)."""
    from handbench.bench.datasets.dataset import IMPORTED, import_capture

    settings: dict[str, Any] = {}
    set_values(settings, options.settings, "parameter=S11")
    free_folder(options.out, options.overwrite, IMPORTED)
    import_capture(options.dataset, options.source, options.out, **settings)
    say(f"the capture is in {options.out}")
