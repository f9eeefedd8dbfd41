"""The stage that computes the transform from the photo frame to the radar frame, radar_from_photo,
from photographs and echoes of a calibration target."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TARGET
from handbench.calibration.array.array_file import ArrayCalibration
from handbench.calibration.registration.register import combine, measure
from handbench.calibration.spheres.description import Target, load_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.dense.fusion import Cloud
from handbench.support.errors import HandbenchError

REGISTRATION = "radar_from_photo.json"


def calibrate(folder: Path, captures: list[str], clouds: list[str]) -> None:
    """Register camera and radar, and write the transform radar_from_photo.json into a stage's
    folder.
    captures: folders of captures of the same calibration target; clouds: for each capture, the file
    with the point cloud reconstructed from its photographs."""
    made = register_captures(
        [Path(capture) for capture in captures], [Cloud.load(Path(file)) for file in clouds]
    )
    made.save(folder / REGISTRATION)


def register_captures(
    captures: Sequence[Path], clouds: Sequence[Cloud], array: ArrayCalibration | None = None
) -> Transform:
    """Compute the transform from the photo frame to the radar frame, from captures of one
    calibration target.
    captures: their folders; clouds: for each capture, the point cloud of its photographs, in the
    photo frame. Several captures are combined into one transform, so the rig of camera and radar
    must not change between them. array: calibration of the antennas, used instead of those in the
    captures' folders. Raises HandbenchError if the captures show different targets."""
    target = common_target(captures)
    measured, names = [], []
    for capture, cloud in zip(captures, clouds, strict=True):
        recorded = open_capture(capture)
        names.append(recorded.about.name)
        echoes = (
            recorded.echoes()
            if array is None
            else array.applied_to(recorded.echoes(calibrated=False))
        )
        measured.append(
            measure(cloud.points_m, cloud.normals, echoes, target, pixel_m=cloud.pixel_m)
        )
    pairs, common_m2 = zip(*measured, strict=True)
    return combine(pairs, np.mean(common_m2, axis=0), names, target.ball_offset_sigma_m)


def common_target(captures: Sequence[Path]) -> Target:
    """Return the description of the calibration target that all captures show.
    captures: their folders. Raises HandbenchError if their target descriptions differ."""
    targets = {capture: load_target(capture / TARGET) for capture in captures}
    for capture, target in targets.items():
        if target != targets[captures[0]]:
            raise HandbenchError(
                f"{capture / TARGET}: describes another target than the file in {captures[0]}; "
                "combine only captures of the same target"
            )
    return targets[captures[0]]
