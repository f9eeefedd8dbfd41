"""Known cameras are used: poses and intrinsics as they are given, points triangulated with them."""

import shutil
from copy import deepcopy

import numpy as np
import pytest

from handbench.groundtruth.camera_files import read_model
from handbench.groundtruth.cameras import load_cameras, registered_images, save_cameras
from handbench.groundtruth.options import SparseOptions
from handbench.groundtruth.sparse.inputs import gather
from handbench.groundtruth.sparse.sparse import register
from tests.groundtruth import room
from tests.refusals import refuse

VIEWS = 3


def solved(folder, **options):
    chosen = SparseOptions(**options)
    return register(gather(folder, chosen), chosen)


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


def test_poses_and_lenses_stay_bit_for_bit_and_points_lie_in_their_frame(found, taken):
    given = load_cameras(taken / "cameras.json")
    assert (
        found.scale.source == "poses" and found.scale.residual_m == 0 and found.scale.used == VIEWS
    )
    for camera, true in zip(found.cameras(), given, strict=True):
        assert camera.params == true.params and camera.t == true.t
        np.testing.assert_allclose(camera.rotation, true.rotation, atol=1e-15)
    points_m = np.array([p.xyz for p in found.model.points3D.values() if p.track.length() >= 3])
    assert len(points_m) > 500 and found.model.compute_mean_reprojection_error() < 0.3
    off_m = np.abs(points_m).min(axis=1)  # the room's planes are x = 0, y = 0, z = 0
    assert np.median(off_m) < 5e-4 and np.quantile(off_m, 0.9) < 3e-3


def test_a_model_without_points_is_completed(found, photos):
    whole = deepcopy(found.model)
    for number in list(whole.points3D):
        whole.delete_point3D(number)
    (photos / "model").mkdir()
    whole.write_binary(photos / "model")
    assert not read_model(photos / "model").num_points3D()
    completed = solved(photos, cameras=photos / "model", metric=True)
    assert completed.scale.source == "poses" and completed.model.num_points3D() > 1000
    given = {camera.name: camera for camera in load_cameras(photos / "cameras.json")}
    for image in registered_images(completed.model):
        np.testing.assert_allclose(
            image.projection_center(), given[image.name].centre_m, atol=1e-12
        )


def test_wrong_poses_are_refused(photos):
    given = load_cameras(photos / "cameras.json")
    turned = [c.model_copy(update={"R": tuple(map(tuple, c.rotation.T.tolist()))}) for c in given]
    save_cameras(photos / "cameras.json", tuple(turned))
    refuse(lambda: solved(photos), "given poses")


@pytest.mark.slow
def test_given_intrinsics_stay(photos):
    K = (440.1, 440.2, 200.3, 150.4)
    held = solved(photos, intrinsics=K, unscaled=True)
    assert {tuple(camera.params) for camera in held.cameras()} == {K}
