"""The cameras' covariance against many draws of the noise."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras import pycolmap, registered_images, set_pose
from handbench.groundtruth.sparse.adjust import camera_covariance, point_covariance
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.normal import normal_equations, parameter_places, project
from tests.groundtruth.noisy_model import adjusted, noisy_model

DRAWS = 25
INTRINSICS = 8


def meeting_point(images, pixels, start_m):
    """The point nearest to the rays of the pixels [n, 2], all pixels with the same weight."""

    def off(point_m):
        return np.concatenate(
            [project(i, point_m[None])[0] - p for i, p in zip(images, pixels, strict=True)]
        )

    return least_squares(off, start_m, method="lm", x_scale=1e-3, xtol=1e-14, ftol=1e-14).x


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "shared"), [(0, False), (INTRINSICS, True)])
def test_errors_of_cameras_are_as_large_as_promised(lens, shared):
    """Their squares in units of the covariance are 1 a parameter. 25 draws of 30 or 38 parameters
    tell that to 5 %. Cauchy's weights make the promise up to 22 % larger than it need be."""
    of_cameras = []
    for seed in range(DRAWS):
        scene = noisy_model(seed, shared=shared)
        covariance, error = adjusted(scene, lens), scene.error(lens)
        of_cameras.append(error @ np.linalg.solve(covariance, error) / len(error))
    assert 0.75 < np.mean(of_cameras) < 1.15


def test_without_a_board_seven_freedoms_are_left_out_and_nothing_else():
    scene = noisy_model()
    matrix = normal_equations(scene.model, {}, {}, 0).information
    covariance = camera_covariance(scene.model, {}, {}, 0, Scale("none"))
    rank = np.linalg.matrix_rank(covariance, tol=1e-9 * np.trace(covariance), hermitian=True)
    assert rank == 5 * 6 - 7
    # a generalised inverse, to the rounding of numbers that differ by 1e4 between metres and
    # radians
    for a, b in ((matrix, covariance), (covariance, matrix)):
        np.testing.assert_allclose(a @ b @ a, a, atol=1e-8 * np.abs(a).max())


def test_a_board_behind_a_camera_is_left_out():
    scene = noisy_model()
    image = registered_images(scene.model)[0]
    turned = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0, np.pi, 0])), np.zeros(3))
    set_pose(image, turned * image.cam_from_world())
    equations = normal_equations(scene.model, scene.corners, scene.corners_m, 0)
    assert np.isfinite(equations.information).all()
    assert not equations.information[:6].any()  # nothing tells of this camera


def test_known_poses_hold_the_frame_to_what_they_miss():
    """The mean of five centres, each known to 2 mm along each axis, is known to 2/√5 mm: no feature
    tells of it."""
    scene = noisy_model()
    images = registered_images(scene.model)
    covariance = camera_covariance(scene.model, {}, {}, 0, Scale("poses", 5, 5, 2e-3))
    # the centre −Rᵀt moves by −Rᵀτ, and not by ω, which turns both t and R
    by_tau = [-image.cam_from_world().rotation.matrix().T / 5 for image in images]
    mean = np.zeros((3, len(covariance)))
    for place, slope in zip(parameter_places(images, 0), by_tau, strict=True):
        mean[:, place[:3]] = slope
    np.testing.assert_allclose(mean @ covariance @ mean.T, 2e-3**2 / 5 * np.eye(3), atol=1e-10)
    free = camera_covariance(scene.model, {}, {}, 0, Scale("none"))
    assert np.trace(free) < np.trace(covariance)


def test_a_point_moves_to_where_the_rays_of_the_moved_cameras_meet():
    """Of one certain movement; the shift is linear to 1e-6 of itself, the step over the
    distance."""
    scene = noisy_model(noise=0, off=0)
    images = registered_images(scene.model)
    places = parameter_places(images, INTRINSICS)
    point_m = np.array([0.03, -0.05, 0.04])
    pixels = [project(image, point_m[None])[0] for image in images]
    step = np.random.default_rng(0).normal(0, 1e-6, 5 * (6 + 8))
    choices = (np.ones(5, bool), np.array([True, False, False, True, False]))
    found = [
        point_covariance(images, np.outer(step, step), point_m[None], seen[None])[0]
        for seen in choices
    ]
    for image, place in zip(images, places, strict=True):
        tau, omega, intrinsics = np.split(step[place], [3, 6])
        pose, turn = image.cam_from_world(), Rotation.from_rotvec(omega).as_matrix()
        rotation = pycolmap.Rotation3d(turn @ pose.rotation.matrix())
        set_pose(image, pycolmap.Rigid3d(rotation, turn @ pose.translation + tau))
        image.camera.params = (np.array(image.camera.params) + intrinsics).tolist()
    for seen, covariance in zip(choices, found, strict=True):
        shown = [image for image, s in zip(images, seen, strict=True) if s]
        chosen = [p for p, s in zip(pixels, seen, strict=True) if s]
        shift_m = meeting_point(shown, chosen, point_m) - point_m
        np.testing.assert_allclose(
            covariance, np.outer(shift_m, shift_m), atol=1e-4 * (shift_m @ shift_m)
        )
