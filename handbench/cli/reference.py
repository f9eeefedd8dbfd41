"""`handbench groundtruth` and `calibrate`: the mesh that depths are compared with, and the
transform from its frame, that of the photographs, to the radar's frame."""

import argparse
from contextlib import ExitStack

import numpy as np

from handbench.bench.datasets.dataset import load_any_transform, open_capture
from handbench.bench.datasets.native import ARRAY, CORRECTIONS
from handbench.calibration.array_file import with_calibration
from handbench.calibration.corrections import from_echoes
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.surface import read_surface
from handbench.interface import MESHES
from handbench.radar.data.depthmap import load_depthmap
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, free, write_json
from handbench.support.progress import print_lines, say, warn

UNITS_M = {"m": 1.0, "mm": 1e-3}


def groundtruth(options: argparse.Namespace) -> None:
    """Reconstruct a mesh in metres from photographs, or convert a mesh file in the unit --unit to
    metres, and write it (-o).
    Prints a sentence about the mesh; --workdir has all figures."""
    free(options.overwrite, options.out)
    if options.photos.suffix.lower() in MESHES and not options.photos.is_dir():
        _take_over(options)
        return
    if options.unit:
        raise HandbenchError(
            f"--unit: is only for a mesh file, but {options.photos} is not one; leave --unit out"
        )
    from handbench.bench.validation.captures import board_warnings
    from handbench.groundtruth.board import load_board
    from handbench.groundtruth.options import Options
    from handbench.groundtruth.photos import find_photos
    from handbench.groundtruth.pipeline import reconstruct
    from handbench.support.config import parse

    if options.workdir and not (options.workdir / "summary.json").exists():
        # which no earlier call has written
        free(options.overwrite, options.workdir / "sparse", options.workdir / "dense.ply")
    values = {name: value for name, value in vars(options).items() if name in Options.model_fields}
    chosen, photos = parse(Options, values, "groundtruth"), find_photos(options.photos)
    described = options.board or options.photos / "board.toml"
    if described.is_file():
        warn(described, board_warnings(photos, load_board(described)))
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

    if not options.unit:
        raise HandbenchError(
            f"--unit: is missing, and {options.photos} does not say in which unit its vertices "
            "are; add --unit m or --unit mm"
        )
    mesh = metric_mesh(options.photos, UNITS_M[options.unit])
    write_mesh(options.out, mesh)
    print_lines(f"{options.out}: {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles")


def calibrate(options: argparse.Namespace) -> None:
    """Compute the transform from the photographs' frame to the radar's frame and write it (-o),
    from captures of the calibration target or, with --refine, by aligning a mesh to a depth map.
    --array also estimates the antennas' gains, phases and delays and writes them to a file."""
    if (options.mesh or options.transform) and not options.refine:
        raise HandbenchError(
            "--mesh, --transform: only --refine uses these options; leave them out, or add "
            "--refine DEPTH.npz"
        )
    if options.from_echoes:
        _from_echoes(options)
        return
    if not options.out:
        raise HandbenchError("-o: is missing; name the file for the transform: -o TRANSFORM.json")
    free(options.overwrite, options.out, options.array)
    with ExitStack() as both:  # files appear at its end, or neither
        transform = _from_surface(options) if options.refine else _from_targets(options, both)
        transform.save(both.enter_context(atomic_path(options.out)))


def _from_echoes(options: argparse.Namespace) -> None:
    """Estimate what a capture declares as unknown from its echoes, and write corrections.json into
    its folder."""
    if len(options.capture) != 1 or options.out:
        raise HandbenchError("--from-echoes: takes one CAPTURE, and leaves -o out")
    capture = open_capture(options.capture[0])
    file = capture.folder / CORRECTIONS
    free(options.overwrite, file)
    echoes, _ = with_calibration(capture.echoes(1, calibrated=False), capture.folder / ARRAY)
    corrections = from_echoes(echoes, capture.about.unknown)
    write_json(file, corrections.model_dump())
    say(f"{file}: {corrections}; all commands apply it to the echoes, which stay as recorded")


def _from_targets(options: argparse.Namespace, files: ExitStack) -> Transform:
    from handbench.bench.stages.calibrate import calibrate_array, calibrate_captures

    if not options.capture:
        raise HandbenchError(
            "TARGET_CAPTURE: is missing; name a capture of the calibration target, or give "
            "--refine DEPTH.npz with --mesh MESH.ply"
        )
    array = None
    if options.array:
        array = calibrate_array(options.capture)
        write_json(files.enter_context(atomic_path(options.array)), array.model_dump())
        say(f"{options.array}: {array.summary()}")
    transform = calibrate_captures(options.capture, options.quality, options.seed, array=array)
    residuals = ", ".join(f"{1e3 * r:.2f}" for r in transform.residuals_m)
    say(
        f"{options.out}: the transform is fitted to {len(transform.residuals_m)} elements of the "
        f"target with residuals of {residuals} mm; {_error(transform)}"
    )
    return transform


def _error(transform: Transform) -> str:
    """Return a sentence with the transform's standard deviations at the hand's centre."""
    from handbench.calibration.registration import HAND_M

    if transform.covariance is None:
        return "no covariance"
    sigma_mm = 1e3 * np.sqrt(np.diag(transform.point_covariance(HAND_M)))
    sigmas = " × ".join(f"{sigma:.2f}" for sigma in sigma_mm)
    return f"error at the hand's centre ± {sigmas} mm (x × y × z, one σ)"


def _from_surface(options: argparse.Namespace) -> Transform:
    from handbench.calibration.refine import refine
    from handbench.groundtruth.mesh.depth import reference_on_grid

    if options.capture or options.mesh is None:
        raise HandbenchError(
            "--refine: aligns a depth map to a surface and needs no calibration target; add --mesh "
            "MESH.ply, and leave out TARGET_CAPTURE"
        )
    surface, depth = read_surface(options.mesh), load_depthmap(options.refine)
    transform = refine(
        lambda moved: reference_on_grid(surface.moved(moved), depth.x_m, depth.y_m).z_m,
        depth,
        load_any_transform(options.transform),
    )
    say(f"{options.out}: {transform.refined}; {_error(transform)}")
    return transform
