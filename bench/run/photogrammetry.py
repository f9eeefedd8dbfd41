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
    """The folder of a capture's photographs, and the options of their reconstruction: those of
    `handbench groundtruth`, within the capture's box. Raises HandbenchError if there are none."""
    recorded = open_capture(capture)
    if recorded.photos is None:
        raise HandbenchError(f"{capture}: has no folder of photographs; add it, or a mesh")
    values = {"quality": quality, "box_m": recorded.about.box_m, "seed": seed}
    # a table is the same on every machine
    options = parse(Options, {**values, "dense": "cpu"}, "groundtruth")
    return recorded.photos, options


def calibrate_array(captures: Sequence[Path]) -> ArrayCalibration:
    """The array's calibration from the first capture of a target, whose echoes are read as
    recorded."""
    [capture, *_] = captures
    recorded = open_capture(capture)
    return estimate_array(
        recorded.echoes(calibrated=False), load_target(capture / TARGET), source=recorded.about.name
    )


def calibrate_captures(
    captures: Sequence[Path], quality: str, seed: int, array: ArrayCalibration | None = None
) -> Transform:
    """Compute radar_from_photo from captures of one target, photographs and echoes, without a
    store."""
    common_target(captures)  # what differs is refused before the work
    clouds = [reconstruct_cloud(*photographs(capture, quality, seed)) for capture in captures]
    return register_captures(captures, clouds, array)
