"""The stage that registers camera and radar: a cloud and echoes of one target to
`radar_from_photo`."""

from pathlib import Path

import numpy as np
import pytest
import tomlkit

from handbench.bench.datasets.native import ECHOES, TARGET, CaptureFile, save_capture_file
from handbench.bench.stages.calibrate import REGISTRATION, calibrate, calibrate_captures
from handbench.calibration.registration import common_covariance
from handbench.calibration.target import default_target
from handbench.calibration.transforms import load_transform
from handbench.groundtruth.dense.fusion import Cloud
from handbench.radar.data.echoes_file import save_capture
from tests.calibration.test_balls import capture, centres
from tests.calibration.test_spheres import scene
from tests.refusals import refuse

TARGET_MADE = default_target()


def target_folder(folder: Path, target=TARGET_MADE) -> Path:
    """A capture folder that has only the target's description."""
    folder.mkdir()
    (folder / TARGET).write_text(tomlkit.dumps(target.model_dump()))
    save_capture_file(folder, CaptureFile(name=folder.name, kind="target"))
    return folder


@pytest.mark.slow
def test_a_cloud_and_echoes_give_the_transform(tmp_path):
    """0.1 mm at every element: spheres are good for 0.02 mm, balls for 0.03 mm each."""
    rng, target = np.random.default_rng(20240607), TARGET_MADE
    points_m, normals, photo_m = scene(rng, target, 0.35)
    radar_m = centres(rng, target)
    folder = target_folder(tmp_path / "target")
    save_capture(folder / ECHOES, capture(rng, target, radar_m, (0, 1, 2, 3, 4), None))
    seen = np.ones((len(points_m), 1), dtype=bool)
    cloud = Cloud(points_m, normals, seen, np.zeros(len(points_m)), ("a.png",), 0.0)
    cloud.save(tmp_path / "cloud.npz")
    calibrate(tmp_path, [str(folder)], [str(tmp_path / "cloud.npz")])
    found = load_transform(tmp_path / REGISTRATION)
    assert (found.source, found.target) == ("photo", "radar")
    miss_m = found.points(photo_m) - radar_m
    assert np.linalg.norm(miss_m, axis=1).max() < 1e-4
    assert len(found.residuals_m) == 5 and max(found.residuals_m) < 1e-4
    predicted_m = np.sqrt(np.diagonal(found.point_covariance(radar_m), axis1=1, axis2=2))
    assert (np.abs(miss_m) < 4 * predicted_m).all() and (predicted_m[:, :2] < 1e-4).all()
    # what the foam may differ by shows in no residual, yet is counted
    assert (predicted_m[:, 2] > np.sqrt(common_covariance(target)[2, 2])).all()


def test_captures_of_two_targets_or_without_photographs_are_refused_before_the_work(tmp_path):
    one = target_folder(tmp_path / "one")
    softer = TARGET_MADE.model_copy(update={"foam_permittivity": 1.05})
    other = target_folder(tmp_path / "other", softer)
    refuse(lambda: calibrate_captures([one, other], "draft", seed=0), "other/target.toml", str(one))
    refuse(lambda: calibrate_captures([one], "draft", seed=0), str(one))
