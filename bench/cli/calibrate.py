"""`handbench calibrate`: where the photographs' frame lies in the radar's."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from bench.cli.options import add_out, free
from radar.support.errors import HandbenchError
from radar.support.progress import say

if TYPE_CHECKING:  # --help answers without it
    from calibration.transforms import Transform

HELP = "target capture → radar_from_photo, covariance, residuals"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Its options."""
    command.add_argument(
        "capture",
        type=Path,
        nargs="*",
        metavar="TARGET_CAPTURE",
        help="several, of one target before a rig that stood still, are combined",
    )
    command.add_argument("--quality", choices=("draft", "normal", "high"), default="draft")
    command.add_argument("--seed", type=int, default=0)
    command.add_argument(
        "--array",
        type=Path,
        metavar="ARRAY.json",
        help="estimate the antennas' gains, phases and places too, write them here and use them",
    )
    command.add_argument(
        "--since",
        type=Path,
        metavar="EARLIER.json",
        help="an earlier calibration of the rig: say whether it has moved since",
    )
    command.add_argument(
        "--maroon",
        type=Path,
        metavar="alignment.json",
        help="write the transform in MAROON's form too; a file that is there keeps its other keys",
    )
    without = command.add_argument_group("without a target (never done silently: the result says so)")
    without.add_argument("--refine", type=Path, metavar="DEPTH.npz", help="align --mesh with this radar depth map")
    without.add_argument("--mesh", type=Path, metavar="MESH.ply", help="metres")
    without.add_argument("--transform", type=Path, metavar="START.json", help="where to start (default: as it lies)")
    add_out(command, "TRANSFORM.json", "transform")


def run(options: argparse.Namespace) -> None:
    """Target captures → transform; or a mesh and a depth map → transform."""
    files = [file for file in (options.out, options.array) if file]
    for file in files:
        free(file, options.overwrite)
    if len({file.resolve() for file in (*files, *filter(None, [options.maroon]))}) < len(files) + bool(options.maroon):
        raise HandbenchError(f"-o, --array, --maroon: name the same file, {options.out}; name different ones")
    transform = _from_surface(options) if options.refine else _from_targets(options)
    transform.save(options.out)
    if options.maroon:
        from bench.datasets.maroon_alignment import save_alignment

        save_alignment(options.maroon, transform)
    if options.since:
        _compare(options.since, transform, options.out)


def _from_targets(options: argparse.Namespace) -> Transform:
    from bench.run.photogrammetry import calibrate_array, calibrate_captures
    from calibration.array.array_file import save_array

    if not options.capture:
        raise HandbenchError("TARGET_CAPTURE: is missing; name a capture of the target, or --refine DEPTH.npz --mesh M")
    if options.mesh or options.transform:
        raise HandbenchError("--mesh, --transform: are for --refine; a target's capture needs neither")
    array = None
    if options.array is not None:
        array = calibrate_array(options.capture)
        save_array(options.array, array)
        say(f"{options.array}: {array.summary()}")
    transform = calibrate_captures(options.capture, options.quality, options.seed, array=array)
    residuals = ", ".join(f"{1e3 * r:.2f}" for r in transform.residuals_m)
    say(f"{options.out}: {len(transform.residuals_m)} elements, residuals {residuals} mm; {expected_error(transform)}")
    return transform


def expected_error(transform: Transform) -> str:
    """The covariance at the middle of the hand, in words."""
    import numpy as np

    from calibration.registration.register import HAND_M

    sigma_mm = 1e3 * np.sqrt(np.diag(transform.point_covariance(HAND_M)))
    return "at the hand's centre ± " + " × ".join(f"{s:.2f}" for s in sigma_mm) + " mm (x × y × z, one σ)"


def _from_surface(options: argparse.Namespace) -> Transform:
    from bench.evaluation.refine import refine_files

    if options.capture or options.array:
        raise HandbenchError("--refine: does without a target; leave TARGET_CAPTURE and --array out")
    if options.mesh is None:
        raise HandbenchError("--refine: needs --mesh MESH.ply, the surface to align")
    transform = refine_files(options.refine, options.mesh, options.transform)
    report = transform.refined
    shift = ", ".join(f"{mm:+.2f}" for mm in report["translation_mm"])
    turn = ", ".join(f"{deg:+.2f}" for deg in report["rotation_deg"])
    say(
        f"{options.out}: moved by ({shift}) mm and turned by ({turn})° about the surface's middle; RMS over "
        f"{report['pixels']} pixels {report['rms_before_mm']:.2f} → {report['rms_after_mm']:.2f} mm; "
        f"{report['reason']}"
    )
    for direction in report["free"]:
        say(f"{options.out}: the surface does not hold {direction}; left as it was")
    return transform


def _compare(since: Path, transform: Transform, out: Path) -> None:
    from calibration.registration.register import motion
    from calibration.transforms import load_transform

    say(motion(load_transform(since), transform, names=(since.name, out.name)).sentence)
