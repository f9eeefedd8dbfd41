"""The stage that computes the transform from the photo frame to the radar frame, radar_from_photo,
from photographs and echoes of a calibration target; and the reconstruction of a capture's
photographs, which `handbench run` and `handbench calibrate` share."""

from collections.abc import Sequence
from pathlib import Path

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import TARGET
from handbench.calibration.array_estimate import estimate_array
from handbench.calibration.array_file import ArrayCalibration
from handbench.calibration.registration import common_covariance, common_pairs, find_centres, solve
from handbench.calibration.target import Target, load_target
from handbench.calibration.transforms import Transform
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.options import Options, Quality
from handbench.groundtruth.pipeline import reconstruct_cloud
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.store import stage

REGISTRATION = "radar_from_photo.json"
# Quality of a calibration target's depth maps. Spheres are fitted to thousands of points: "normal"
# is 0.02 mm more accurate, and its depth maps take five times as long.
TARGET_QUALITY: Quality = "draft"


@stage(
    "calibrate",
    "bench/stages/calibrate.py",
    "bench/datasets",
    "calibration",
    "groundtruth",
    "radar/data",
    "radar/imaging",
    "radar/simulation",
)
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
    pairs = []
    for capture, cloud in zip(captures, clouds, strict=True):
        recorded = open_capture(capture)
        echoes = recorded.echoes(calibrated=array is None)
        if array is not None:
            echoes = array.applied_to(echoes)
        centres = find_centres(cloud.points_m, cloud.normals, echoes, target, cloud.pixel_m)
        pairs.append(common_pairs(*centres, target, recorded.about.name, len(captures)))
    pixel_m = max(cloud.pixel_m for cloud in clouds)
    return solve(sum(pairs[1:], pairs[0]), common_covariance(target, pixel_m))


def common_target(captures: Sequence[Path]) -> Target:
    """Return the description of the calibration target that all captures show.
    captures: their folders. Raises HandbenchError if their target descriptions differ."""
    if not captures:
        raise HandbenchError("captures: none is given; name one of the calibration target")
    targets = {capture: load_target(capture / TARGET) for capture in captures}
    for capture, target in targets.items():
        if target != targets[captures[0]]:
            raise HandbenchError(
                f"{capture / TARGET}: describes another target than the file in {captures[0]}; "
                "combine only captures of the same target"
            )
    return targets[captures[0]]


def photographs(capture: Path, quality: str, seed: int) -> tuple[Path, Options]:
    """Return the folder of a capture's photographs, and the options of their reconstruction.
    quality: "draft" or another value of `handbench groundtruth --quality`; seed: of random numbers.
    Only points inside the capture's box are kept. Raises HandbenchError if the capture has no
    photographs."""
    recorded = open_capture(capture)
    if recorded.photos is None:
        raise HandbenchError(f"{capture}: has no folder of photographs; add photographs, or a mesh")
    values = {
        "quality": quality,
        "box_m": recorded.about.box_m,
        "seed": seed,
        "dense": "cpu",  # a table is the same on every machine
    }
    return recorded.photos, parse(Options, values, "groundtruth")


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
