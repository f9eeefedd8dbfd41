"""`handbench calibrate`: compute the transform from the photographs' frame to the radar's frame."""

import argparse
from contextlib import ExitStack

import numpy as np

from handbench.bench.datasets.dataset import load_any_transform, open_capture
from handbench.bench.datasets.native import ARRAY, CORRECTIONS
from handbench.bench.stages.calibrate import calibrate_array, calibrate_captures
from handbench.calibration.array_file import with_calibration
from handbench.calibration.corrections import from_echoes
from handbench.calibration.refine import refine
from handbench.calibration.registration import HAND_M
from handbench.calibration.transforms import Transform
from handbench.cli.options import free
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.depthmap import load_depthmap
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, write_json
from handbench.support.progress import say


def run(options: argparse.Namespace) -> None:
    """Compute the transform from the photographs' frame to the radar's frame and write it (-o),
    from captures of the calibration target or, with --refine, by aligning a mesh to a depth map.
    --array also estimates the antennas' gains, phases and delays and writes them to a file."""
    if options.from_echoes:
        _from_echoes(options)
        return
    if options.out is None:
        raise HandbenchError("-o: is missing; name the file for the transform: -o TRANSFORM.json")
    for file in filter(None, (options.out, options.array)):
        free(file, options.overwrite)
    with ExitStack() as both:  # files appear at its end, or neither
        transform = _from_surface(options) if options.refine else _from_targets(options, both)
        transform.save(both.enter_context(atomic_path(options.out)))


def _from_echoes(options: argparse.Namespace) -> None:
    """Estimate what a capture declares as unknown from its echoes, and write corrections.json into
    its folder."""
    others = (options.out, options.array, options.refine, options.mesh, options.transform)
    if len(options.capture) != 1 or any(others):
        raise HandbenchError(
            "--from-echoes: takes one CAPTURE and no other file; leave -o, --array, --refine, "
            "--mesh and --transform out"
        )
    capture = open_capture(options.capture[0])
    file = capture.folder / CORRECTIONS
    free(file, options.overwrite)
    echoes, _ = with_calibration(capture.echoes(1, calibrated=False), capture.folder / ARRAY)
    corrections = from_echoes(echoes, capture.about.unknown)
    write_json(file, corrections.model_dump())
    say(f"{file}: {corrections}; all commands apply it to the echoes, which stay as recorded")


def _from_targets(options: argparse.Namespace, files: ExitStack) -> Transform:
    if not options.capture:
        raise HandbenchError(
            "TARGET_CAPTURE: is missing; name a capture of the calibration target, or give "
            "--refine DEPTH.npz with --mesh MESH.ply"
        )
    if options.mesh or options.transform:
        raise HandbenchError(
            "--mesh, --transform: only --refine uses these options; leave them out, or add "
            "--refine DEPTH.npz"
        )
    array = None
    if options.array is not None:
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
    if transform.covariance is None:
        return "no covariance"
    sigma_mm = 1e3 * np.sqrt(np.diag(transform.point_covariance(HAND_M)))
    sigmas = " × ".join(f"{sigma:.2f}" for sigma in sigma_mm)
    return f"error at the hand's centre ± {sigmas} mm (x × y × z, one σ)"


def _from_surface(options: argparse.Namespace) -> Transform:
    if options.capture or options.array:
        raise HandbenchError(
            "--refine: aligns a depth map to a mesh and needs no calibration target; leave out "
            "TARGET_CAPTURE and --array"
        )
    if options.mesh is None:
        raise HandbenchError(
            "--refine: needs a surface to align the depth map to; add --mesh MESH.ply"
        )
    surface, depth = read_surface(options.mesh), load_depthmap(options.refine)
    transform = refine(
        lambda moved: reference_on_grid(surface.moved(moved), depth.x_m, depth.y_m).z_m,
        depth,
        load_any_transform(options.transform),
    )
    say(f"{options.out}: {transform.refined}; {_error(transform)}")
    return transform
