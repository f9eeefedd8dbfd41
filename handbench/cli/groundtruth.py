"""`handbench groundtruth`: make a mesh in metres from photographs, or from a mesh of another
program."""

import argparse

from handbench.cli.options import free
from handbench.interface import MESHES
from handbench.support.errors import HandbenchError
from handbench.support.progress import print_lines

MILLIMETRE_M = 1e-3


def run(options: argparse.Namespace) -> None:
    """Reconstruct a mesh in metres from photographs, or convert a mesh file in the unit --unit to
    metres, and write it (-o).
    Prints a sentence about the mesh; --workdir has all figures."""
    free(options.out, options.overwrite)
    if options.photos.suffix.lower() in MESHES and not options.photos.is_dir():
        _take_over(options)
        return
    if options.unit is not None:
        raise HandbenchError(
            f"--unit: is only for a mesh file, but {options.photos} is not one; leave --unit out"
        )
    from handbench.bench.validation.captures import board_warnings
    from handbench.groundtruth.board import load_board
    from handbench.groundtruth.options import Options
    from handbench.groundtruth.photos import find_photos
    from handbench.groundtruth.pipeline import reconstruct
    from handbench.support.config import parse
    from handbench.support.progress import say

    if options.workdir and not (options.workdir / "summary.json").exists():
        for name in ("sparse", "dense.ply"):  # which no earlier call has written
            free(options.workdir / name, options.overwrite)
    values = {name: value for name, value in vars(options).items() if name in Options.model_fields}
    chosen, photos = parse(Options, values, "groundtruth"), find_photos(options.photos)
    described = options.board or options.photos / "board.toml"
    for warning in board_warnings(photos, load_board(described)) if described.is_file() else ():
        say(f"{described}: {warning}")
    result = reconstruct(options.photos, chosen, options.workdir)
    result.surface.save(options.out)
    facts, source = result.summary, result.summary["scale"]["source"]
    scale = "no scale" if source == "none" else f"σ {1e3 * facts['sigma_m']:.2g} mm by {source}"
    print_lines(
        f"{options.out}: {facts['triangles']} triangles of {facts['registered']} photographs, "
        f"{100 * facts['observed']:.0f} % of the vertices observed; {scale}"
    )


def _take_over(options: argparse.Namespace) -> None:
    from handbench.groundtruth.mesh.surface import metric_mesh, write_mesh

    if options.unit is None:
        raise HandbenchError(
            f"--unit: is missing, and {options.photos} does not say in which unit its vertices "
            "are; add --unit m or --unit mm"
        )
    mesh = metric_mesh(options.photos, MILLIMETRE_M if options.unit == "mm" else 1.0)
    write_mesh(options.out, mesh)
    print_lines(f"{options.out}: {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles")
