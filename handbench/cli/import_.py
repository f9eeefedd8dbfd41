"""`handbench import`: foreign data as a capture folder, or a foreign hand as a scene."""

import argparse

from handbench.cli.options import free_folder
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Convert foreign data to a capture folder, or a hand of MakeHuman to a scene, and write it
    (-o)."""
    from handbench.bench.datasets.dataset import IMPORTED, import_capture
    from handbench.bench.datasets.foam_panel import import_planar_scan
    from handbench.bench.scenes.makehuman import HAND, SCENE, import_makehuman

    if options.dataset == "makehuman":
        free_folder(options.out, options.overwrite, (SCENE, HAND))
        import_makehuman(options.source, options.out)
        say(f"scene: {options.out / SCENE}")
        return
    free_folder(options.out, options.overwrite, IMPORTED)
    if options.dataset == "planar_scan":
        import_planar_scan(options.source, options.out)
    else:
        import_capture(options.dataset, options.source, options.out)
    say(f"capture: {options.out}")
