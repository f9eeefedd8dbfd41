"""Reconstruction of a capture's photographs, with the settings that `handbench run` and `handbench
calibrate` share."""

from collections.abc import Sequence
from pathlib import Path

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TARGET
from handbench.bench.run.calibrate_stage import common_target, register_captures
from handbench.calibration.array.array_file import ArrayCalibration
from handbench.calibration.array.estimate import estimate_array
from handbench.calibration.spheres.description import load_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.options import Options, Quality
from handbench.groundtruth.pipeline import reconstruct_cloud
from handbench.support.config import parse
from handbench.support.errors import HandbenchError

# Quality of a calibration target's depth maps. Spheres are fitted to thousands of points: "normal"
# is 0.02 mm more accurate, and its depth maps take five times as long.
TARGET_QUALITY: Quality = "draft"


def photographs(capture: Path, quality: str, seed: int) -> tuple[Path, Options]:
    """Return the folder of a capture's photographs, and the options of their reconstruction.
    quality: "draft" or another value of `handbench groundtruth --quality`; seed: of random numbers.
    Only points inside the capture's box are kept. Raises HandbenchError if the capture has no
    photographs."""
    recorded = open_capture(capture)
    if recorded.photos is None:
        raise HandbenchError(f"{capture}: has no folder of photographs; add photographs, or a mesh")
    values = {"quality": quality, "box_m": recorded.about.box_m, "seed": seed}
    # a table is the same on every machine
    options = parse(Options, {**values, "dense": "cpu"}, "groundtruth")
    return recorded.photos, options


def calibrate_array(captures: Sequence[Path]) -> ArrayCalibration:
    """Estimate the calibration of the antennas from the echoes of a known target.
    captures: folders, of which only the first is used; its echoes are read without any
    calibration."""
    [capture, *_] = captures
    recorded = open_capture(capture)
    return estimate_array(
        recorded.echoes(calibrated=False), load_target(capture / TARGET), source=recorded.about.name
    )


def calibrate_captures(
    captures: Sequence[Path], quality: str, seed: int, array: ArrayCalibration | None = None
) -> Transform:
    """Compute the transform from the photo frame to the radar frame, from photographs and echoes of
    captures of one calibration target.
    captures: their folders. quality, seed: of the photographs' reconstruction. array: calibration
    of the antennas, used instead of those in the captures' folders. Intermediate results are not
    stored. Raises HandbenchError if the captures show different targets."""
    common_target(captures)  # what differs is refused before the work
    clouds = [reconstruct_cloud(*photographs(capture, quality, seed)) for capture in captures]
    return register_captures(captures, clouds, array)
