"""Bundle adjustment with the board in it, on synthetic cameras with seeded noise."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from tests.groundtruth.noisy_model import PARAMS, adjusted, noisy_model, off_in_sigmas, poses_of

INTRINSICS = 8


def points_of(scene):
    return np.array([p.xyz for _, p in sorted(scene.model.points3D.items())])


@pytest.mark.parametrize("lens", [0, INTRINSICS])
def test_poses_and_intrinsics_come_back(lens):
    """Of 38 numbers at most, one is beyond 4.5 σ once in 4000 scenes."""
    scene = noisy_model(1, off=5e-3, shared=bool(lens))
    before = np.abs(scene.error(lens))
    sigma = np.sqrt(np.diag(adjusted(scene, lens)))
    assert (before[:30] / sigma[:30]).mean() > 4  # there is something to do
    assert (np.abs(scene.error(lens)) / sigma).max() < 4.5
    assert np.abs(points_of(scene) - scene.points_m).max() < 2e-3
    for camera in scene.model.cameras.values():
        assert (np.array(camera.params) != PARAMS).all() == bool(lens)


@pytest.mark.parametrize(
    ("lens", "params"), [(0, PARAMS), (INTRINSICS, (440, 440, 200, 150, 0, 0, 0, 0))]
)
def test_without_noise_nothing_is_left(lens, params):
    """But the last step's square, where σ is that of corners of 0.002 px. With free intrinsics only
    for a lens as the priors expect it: they are the one thing that pulls."""
    assert off_in_sigmas(noisy_model(noise=0, off=5e-3, params=params), lens) < 1e-4


def test_one_camera_of_all_photographs_has_one_set_of_columns():
    own, shared = noisy_model(), noisy_model(shared=True)
    of_own, of_shared = adjusted(own, INTRINSICS), adjusted(shared, INTRINSICS)
    assert (len(of_own), len(of_shared)) == (5 * 6 + 5 * 8, 5 * 6 + 8)
    # five photographs instead of one, and poses that share what is not known: 1/√5 at most
    variance, of_each = np.diag(of_shared), np.diag(of_own)
    assert variance[30:38].max() < of_each[30:38].max() / 5
    assert (np.abs(shared.error(INTRINSICS)) / np.sqrt(variance)).max() < 4.5


def test_points_that_are_left_out_follow():
    """4 µrad of noise from 0.6 m at 17° between neighbours is some 20 µm, a few times that in one
    of 40."""
    scene = noisy_model(seen_by=2, noise=0.01, off=5e-3)
    adjusted(scene)
    assert np.abs(points_of(scene) - scene.points_m).max() < 2e-4


def test_the_number_of_blas_threads_changes_nothing():
    one, two = noisy_model(points=200), noisy_model(points=200)  # BLAS divides products so large
    for scene, threads in ((one, 1), (two, 2)):
        with threadpool_limits(threads):
            adjusted(scene)
    np.testing.assert_array_equal(poses_of(one.model), poses_of(two.model))


def test_a_photograph_of_nothing_stays_and_a_point_behind_counts_for_nothing():
    scene = noisy_model()
    for point in list(scene.model.points3D.values()):
        [element] = [e for e in point.track.elements if e.image_id == 5]
        scene.model.delete_observation(5, element.point2D_idx)
    scene.corners["p4.png"] = {}
    scene.model.points3D[1].xyz = np.array([0.0, 0.0, 3.0])  # behind all cameras
    before = poses_of(scene.model)
    sigma = np.sqrt(np.diag(adjusted(scene)))[:24]
    np.testing.assert_allclose(poses_of(scene.model)[4], before[4], atol=1e-15)
    assert (np.abs(scene.error())[:24] / sigma).max() < 4.5
