"""The stage that registers the sensors: photographs and echoes of one target → radar_from_photo."""

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
    """Register camera and radar, and write radar_from_photo.json into a stage's folder.
    captures: folders that show one calibration target; clouds: for each, the file of its
    photographs' point cloud."""
    made = register_captures(
        [Path(capture) for capture in captures], [Cloud.load(Path(file)) for file in clouds]
    )
    made.save(folder / REGISTRATION)


def register_captures(
    captures: Sequence[Path], clouds: Sequence[Cloud], array: ArrayCalibration | None = None
) -> Transform:
    """Compute radar_from_photo from captures of one calibration target.
    clouds: for each capture, the point cloud of its photographs, in the photo frame. Several
    captures are combined; the rig must not move between them. array: the antennas' calibration,
    used in place of the captures' own. Raises HandbenchError for different targets."""
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
    return combine(pairs, False, np.mean(common_m2, axis=0), names, target.ball_offset_sigma_m)


def common_target(captures: Sequence[Path]) -> Target:
    """Return the description of the calibration target that all captures show. Raises
    HandbenchError if their descriptions differ."""
    targets = {capture: load_target(capture / TARGET) for capture in captures}
    for capture, target in targets.items():
        if target != targets[captures[0]]:
            raise HandbenchError(
                f"{capture / TARGET}: describes another target than the file in {captures[0]}; "
                "combine only captures of the same target"
            )
    return targets[captures[0]]
