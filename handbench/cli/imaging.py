"""`handbench inspect`, `reconstruct` and `evaluate`: check a capture or another file, image it by a
method, and compute the errors of the depth map against a mesh."""

import argparse
import sys
from contextlib import ExitStack
from typing import Any

import numpy as np

# The engine is imported when it is used, after the user's input has been checked.
from handbench.bench.datasets.dataset import load_any_transform, open_capture
from handbench.bench.evaluation.metrics import definitions
from handbench.bench.stages.image import configured, image
from handbench.bench.validation.checks import CHANNELS, MAP, on_target, warnings_of
from handbench.cli.options import set_values
from handbench.interface import Capture, Depth
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.imaging.device import describe
from handbench.radar.methods.backprojection import Backprojection, volume
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, free, write_npz
from handbench.support.progress import counted, is_terminal, print_json, print_lines, say, warn

EXACT = 1e-5  # what the exact sum is good to, in single precision


def inspect(options: argparse.Namespace) -> None:
    """Check files and captures before a run, and print problems and warnings, each with a remedy.
    The exit code is 2 if a run would fail, and 0 if there are only warnings."""
    from handbench.bench.validation import inspection

    inspection.show([str(path) for path in options.paths])


def reconstruct(options: argparse.Namespace) -> None:
    """Image one frame of a capture by one method; write the depth map (-o) and, with --volume, the
    image volume, both or neither.
    Prints warnings and the number of pixels with a depth."""
    free(options.overwrite, options.out, options.volume)
    chosen, recorded = method(options.method), open_capture(options.capture)
    values = configured(recorded.about, chosen.id, {}).model_dump(mode="json")
    set_values(values, options.settings, "z.step_m=0.002")
    if options.exact or options.tolerance is not None:
        values["tolerance"] = options.tolerance
    settings = chosen.configure(values, "--set or --tolerance")
    volume_asked = options.volume or options.check
    if volume_asked and not isinstance(settings, Backprojection):
        raise HandbenchError(
            f"--volume, --check: the method '{chosen.id}' computes no volume; choose --method "
            "broadband or narrowband, or leave these options out"
        )
    echoes = recorded.echoes(max(options.frame, 0) + 1)
    warn(options.capture, warnings_of(echoes, CHANNELS))  # they may say why a tone is missing
    with counted(1) as progress, progress.part(f"imaging by {chosen.id}"):
        depth = image(echoes, chosen, settings, options.frame)
    warn(options.out, warnings_of(depth, MAP))
    with ExitStack() as both:  # files appear at its end, or neither
        depth.save(both.enter_context(atomic_path(options.out)))
        if isinstance(settings, Backprojection) and volume_asked:
            voxels = volume(echoes, settings, options.frame)
            if options.volume:
                axes = {f"{name}_m": getattr(settings, name).values_m() for name in "xyz"}
                write_npz(both.enter_context(atomic_path(options.volume)), volume=voxels, **axes)
            if options.check:
                _check(voxels, echoes, settings, options)
    say(f"{options.out}: {on_target(depth)}, imaged on {describe()}")


def _check(
    volume: np.ndarray, echoes: RadarCapture, settings: Backprojection, options: argparse.Namespace
) -> None:
    """Compare a volume [nz, ny, nx] with the exact sum over all samples at random voxels, and print
    the relative error.
    settings: configuration of the method, with tones and grid. Raises HandbenchError if the error
    is larger than its tolerance."""
    from handbench.radar.imaging.exact import imaging_error

    samples, frequencies_hz = echoes.tones(settings.frequencies_hz, options.frame)
    count = min(options.check, volume.size)
    error = imaging_error(volume, samples, frequencies_hz, echoes.aperture, settings.voxels, count)
    say(f"checked at {count} random voxels against the exact sum: relative error {error:.1e}")
    if error > (most := settings.tolerance or EXACT):
        raise HandbenchError(
            f"--check: the volume's relative error is {error:.1e}, but expected at most {most:g}; "
            "use --exact, and please report this capture to the authors"
        )


def evaluate(options: argparse.Namespace) -> None:
    """Compare a depth map with a mesh and print the metrics on stdout: as a table on a terminal or
    with --table, otherwise as JSON, with their definitions only if --json asks for it.
    Warnings are printed first, on stderr."""
    free(options.overwrite, options.plot)
    depth, transform = load_depthmap(options.depth), load_any_transform(options.transform)
    capture = options.capture and Capture(options.capture)
    score = Depth(depth, capture, options.depth).evaluate(options.mesh, transform, options.protocol)
    about: dict[str, Any] = {"method": depth.method}
    if options.json:
        about["definitions"] = definitions(score)
    if transform.refined:
        about["refined"] = f"{options.transform}: {transform.refined}"
    if options.plot:
        score.plot(options.plot)
    if options.json or not (options.table or is_terminal(sys.stdout)):
        print_json({"warnings": score.warnings} | score | about)
    else:
        from handbench.reports.tables.table import of_values
        from handbench.reports.tables.writers import terminal

        table = of_values(str(options.depth), {depth.method: score}).turned
        terminal(table, "the output of --json")
        if transform.refined:
            print_lines(about["refined"])
