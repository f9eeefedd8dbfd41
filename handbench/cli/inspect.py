"""`handbench inspect`: find problems in files and captures, and say how to mend them."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Check files and captures before a run, and print problems and warnings, each with a remedy.
    The exit code is 2 if a run would fail, and 0 if there are only warnings."""
    from handbench.bench.validation.inspection import show

    if (options.mesh or options.transform) and [path.suffix for path in options.paths] != [".npz"]:
        raise HandbenchError(
            "--mesh, --transform: are only for one DEPTH.npz, because a capture folder has its "
            "own mesh and transform; leave them out"
        )
    show([str(path) for path in options.paths], options.mesh, options.transform)
