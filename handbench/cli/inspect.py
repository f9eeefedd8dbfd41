"""`handbench inspect`: what is wrong, or seems wrong, with any file that handbench reads, and what
to do."""

import argparse

from handbench.support.errors import HandbenchError


def run(options: argparse.Namespace) -> None:
    """Print problems and warnings; exit code 2 where a run would fail, 0 where it would only be
    doubtful."""
    from handbench.bench.validation.inspection import show

    if (options.mesh or options.transform) and [path.suffix for path in options.paths] != [".npz"]:
        raise HandbenchError(
            "--mesh, --transform: are for a DEPTH.npz; a capture has its own surface in its folder"
        )
    show([str(path) for path in options.paths], options.mesh, options.transform)
