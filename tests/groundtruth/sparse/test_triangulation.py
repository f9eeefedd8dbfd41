"""Known cameras are used: poses and intrinsics as they are given, points triangulated with them."""

import shutil
from copy import deepcopy

import numpy as np
import pytest

from handbench.calibration.transforms import umeyama
from handbench.groundtruth.cameras.camera_files import read_model
from handbench.groundtruth.cameras.cameras import load_cameras, registered_images, save_cameras
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.sparse.inputs import gather
from handbench.groundtruth.sparse.sparse import register
from handbench.support.errors import HandbenchError
from tests.groundtruth import room

VIEWS = 4


def solved(folder, **options):
    inputs, chosen = gather(folder, SparseOptions(**options))
    return register(inputs, chosen)


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """Photographs of a room's corner, and the true cameras beside them."""
    folder = tmp_path_factory.mktemp("room")
    room.photograph(folder, VIEWS)
    cameras = (room.true_camera(f"p{i}.png", at_m) for i, at_m in enumerate(room.around(VIEWS)))
    save_cameras(folder / "cameras.json", tuple(cameras))
    return folder


@pytest.fixture(scope="module")
def found(taken):
    """What is found with the true cameras; no test changes it."""
    return solved(taken)


@pytest.fixture
def photos(taken, tmp_path):
    """The photographs and cameras in a folder of the test's own."""
    return shutil.copytree(taken, tmp_path / "photos")


def _off_m(cameras, true):
    """Mean distance of the cameras' centres from the true ones after one similarity."""
    centres_m, true_m = (
        np.array([c.centre_m for c in each]) for each in (cameras, [true[c.name] for c in cameras])
    )
    matrix = umeyama(centres_m, true_m, with_scale=True)
    return np.linalg.norm(centres_m @ matrix[:3, :3].T + matrix[:3, 3] - true_m, axis=1).mean()


def test_poses_and_lenses_stay_bit_for_bit_and_points_lie_in_their_frame(found, taken):
    given = load_cameras(taken / "cameras.json")
    assert (
        found.scale.source == "poses" and found.scale.residual_m == 0 and found.scale.used == VIEWS
    )
    for camera, true in zip(found.cameras(), given, strict=True):
        assert camera.params == true.params and camera.t == true.t
        np.testing.assert_allclose(camera.rotation, true.rotation, atol=1e-15)
    points_m = np.array([p.xyz for p in found.model.points3D.values() if p.track.length() >= 3])
    assert len(points_m) > 1000 and found.model.compute_mean_reprojection_error() < 0.3
    off_m = np.abs(points_m).min(axis=1)  # the room's planes are x = 0, y = 0, z = 0
    assert np.median(off_m) < 5e-4 and np.quantile(off_m, 0.9) < 3e-3


@pytest.mark.slow
def test_refined_poses_come_nearer_to_the_truth_and_the_change_is_reported(photos, capsys):
    true = {camera.name: camera for camera in load_cameras(photos / "cameras.json")}
    random = np.random.default_rng(0)
    given = tuple(
        c.model_copy(update={"t": tuple(c.translation_m + random.normal(0, 2e-3, 3))})
        for c in true.values()
    )
    save_cameras(photos / "moved.json", given)
    held = solved(photos, cameras=photos / "moved.json")
    assert [camera.t for camera in held.cameras()] == [camera.t for camera in given]
    refined = solved(photos, cameras=photos / "moved.json", refine_poses=True)
    printed = [
        line for line in capsys.readouterr().err.splitlines() if line.startswith("refined: ")
    ]
    assert len(printed) == 1 and "the given cameras moved by" in printed[0]
    assert (
        refined.model.compute_mean_reprojection_error()
        < 0.5 * held.model.compute_mean_reprojection_error()
    )
    assert _off_m(refined.cameras(), true) < 0.2 * _off_m(given, true)
    assert 0 < refined.scale.residual_m < 6e-3


def test_a_model_without_points_is_completed(found, photos):
    whole = deepcopy(found.model)
    for number in list(whole.points3D):
        whole.delete_point3D(number)
    (photos / "model").mkdir()
    whole.write_binary(photos / "model")
    assert not read_model(photos / "model").num_points3D()
    completed = solved(photos, model=photos / "model", metric=True)
    assert completed.scale.source == "model" and completed.model.num_points3D() > 1000
    given = {camera.name: camera for camera in load_cameras(photos / "cameras.json")}
    for image in registered_images(completed.model):
        np.testing.assert_allclose(
            image.projection_center(), given[image.name].centre_m, atol=1e-12
        )


def test_wrong_poses_are_refused(photos):
    given = load_cameras(photos / "cameras.json")
    turned = tuple(
        c.model_copy(update={"R": tuple(map(tuple, c.rotation.T.tolist()))}) for c in given
    )
    save_cameras(photos / "turned.json", turned)
    with pytest.raises(
        HandbenchError, match=r"matched features agree with the given poses.*world to camera"
    ):
        solved(photos, cameras=photos / "turned.json")


@pytest.mark.slow
def test_a_distortion_that_was_not_asked_for_stays_zero(photos):
    K = (440.1, 440.2, 200.3, 150.4)
    held = solved(photos, intrinsics=K, unscaled=True)
    assert {tuple(camera.params) for camera in held.cameras()} == {K}
    free = solved(photos, intrinsics=K, refine_distortion=True, unscaled=True)
    [params] = {tuple(camera.params) for camera in free.cameras()}
    assert params[:4] == K and all(params[4:])
