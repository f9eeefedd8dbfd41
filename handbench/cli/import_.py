"""`handbench import`: convert data of other programs and sensors to a capture folder, or a hand of
MakeHuman to a scene."""

import argparse
from typing import Any

from handbench.cli.options import free_folder, set_values
from handbench.support.errors import HandbenchError
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Convert a data set in another format to a capture folder, or a hand of MakeHuman to a scene,
    and write it (-o)."""
    from handbench.bench.datasets.dataset import IMPORTED, import_capture
    from handbench.bench.datasets.foam_panel import import_planar_scan
    from handbench.bench.datasets.ti_raw import import_ti_raw
    from handbench.bench.datasets.touchstone import import_touchstone
    from handbench.bench.scenes.makehuman import HAND, SCENE, import_makehuman

    settings: dict[str, Any] = {}
    set_values(settings, options.settings, "parameter=S11")
    with_settings = {"touchstone": import_touchstone, "ti-raw": import_ti_raw}
    if settings and options.dataset not in with_settings:
        raise HandbenchError(
            f"--set: the data set '{options.dataset}' has no settings; leave --set out"
        )
    if options.dataset == "makehuman":
        free_folder(options.out, options.overwrite, (SCENE, HAND))
        import_makehuman(options.source, options.out)
        say(f"scene: {options.out / SCENE}")
        return
    free_folder(options.out, options.overwrite, IMPORTED)
    if options.dataset in with_settings:
        with_settings[options.dataset](options.source, options.out, settings)
    elif options.dataset == "planar_scan":
        import_planar_scan(options.source, options.out)
    else:
        import_capture(options.dataset, options.source, options.out)
    say(f"the capture is in {options.out}")
