"""`handbench import`: convert data of other programs and sensors to a capture folder."""

import argparse
from typing import Any

from handbench.cli.options import free_folder, set_values
from handbench.support.errors import HandbenchError
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Convert a data set in another format to a capture folder, and write it (-o)."""
    from handbench.bench.datasets.dataset import IMPORTED, import_capture
    from handbench.bench.datasets.ti import import_ti_raw
    from handbench.bench.datasets.touchstone import import_touchstone

    settings: dict[str, Any] = {}
    set_values(settings, options.settings, "parameter=S11")
    with_settings = {"touchstone": import_touchstone, "ti-raw": import_ti_raw}
    if settings and options.dataset not in with_settings:
        raise HandbenchError(
            f"--set: the data set '{options.dataset}' has no settings; leave --set out"
        )
    free_folder(options.out, options.overwrite, IMPORTED)
    if options.dataset in with_settings:
        with_settings[options.dataset](options.source, options.out, settings)
    else:
        import_capture(options.dataset, options.source, options.out)
    say(f"the capture is in {options.out}")
