"""Reconstruction of a capture's photographs, as `handbench run` and `handbench calibrate` do it."""

from collections.abc import Sequence
from pathlib import Path

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TARGET
from handbench.bench.run.calibrate_stage import common_target, register_captures
from handbench.calibration.array.array_file import ArrayCalibration
from handbench.calibration.array.estimate import estimate_array
from handbench.calibration.spheres.description import load_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.options import Options
from handbench.groundtruth.pipeline import reconstruct_cloud
from handbench.support.config import parse
from handbench.support.errors import HandbenchError


def photographs(capture: Path, quality: str, seed: int) -> tuple[Path, Options]:
    """Return the folder of a capture's photographs, and the options of their reconstruction.
    quality: as in `handbench groundtruth --quality`. Only points in the capture's box are kept.
    Raises HandbenchError if it has no photographs."""
    recorded = open_capture(capture)
    if recorded.photos is None:
        raise HandbenchError(f"{capture}: has no folder of photographs; add photographs, or a mesh")
    values = {"quality": quality, "box_m": recorded.about.box_m, "seed": seed}
    # a table is the same on every machine
    options = parse(Options, {**values, "dense": "cpu"}, "groundtruth")
    return recorded.photos, options


def calibrate_array(captures: Sequence[Path]) -> ArrayCalibration:
    """Estimate the antennas' calibration from the echoes of a known target, in the first of the
    captures, read as recorded."""
    [capture, *_] = captures
    recorded = open_capture(capture)
    return estimate_array(
        recorded.echoes(calibrated=False), load_target(capture / TARGET), source=recorded.about.name
    )


def calibrate_captures(
    captures: Sequence[Path], quality: str, seed: int, array: ArrayCalibration | None = None
) -> Transform:
    """Compute radar_from_photo from the photographs and echoes of captures of one target.
    quality, seed: of the reconstruction of the photographs; array: the antennas' calibration, used
    in place of the captures' own. No intermediate results are kept. Raises HandbenchError for
    different targets."""
    common_target(captures)  # what differs is refused before the work
    clouds = [reconstruct_cloud(*photographs(capture, quality, seed)) for capture in captures]
    return register_captures(captures, clouds, array)
