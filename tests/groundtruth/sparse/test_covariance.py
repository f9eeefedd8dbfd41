"""The cameras' covariance against many draws of the noise."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from handbench.groundtruth.sparse.adjust import (
    CameraCovariance,
    camera_covariance,
    point_covariance,
)
from handbench.groundtruth.sparse.bundle import Bundle
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.jacobians import project
from tests.groundtruth.noisy_model import adjusted, noisy_model

DRAWS = 25
INTRINSICS = tuple(range(8))


def meeting_point(images, pixels, start_m):
    """The point nearest to the rays of the pixels [n, 2], all pixels with the same weight."""

    def off(point_m):
        return np.concatenate(
            [project(i, point_m[None])[0] - p for i, p in zip(images, pixels, strict=True)]
        )

    return least_squares(off, start_m, method="lm", x_scale=1e-3, xtol=1e-14, ftol=1e-14).x


@pytest.mark.slow
@pytest.mark.parametrize(("free", "shared"), [((), False), (INTRINSICS, True)])
def test_errors_of_cameras_are_as_large_as_promised(free, shared):
    """Their squares in units of the covariance are 1 a parameter. 25 draws of 30 or 38 parameters
    tell that to 5 %. Cauchy's weights make the promise up to 22 % larger than it need be."""
    of_cameras = []
    for seed in range(DRAWS):
        scene = noisy_model(seed, shared=shared)
        bundle, known = adjusted(scene, free)
        error = scene.error(bundle)
        of_cameras.append(error @ np.linalg.solve(known.matrix, error) / len(error))
    assert 0.75 < np.mean(of_cameras) < 1.15


def test_without_a_board_seven_freedoms_are_left_out_and_nothing_else():
    scene = noisy_model()
    bundle = Bundle(scene.model, {}, {})
    information, _, _ = bundle.normal().reduced(0.0)
    covariance = camera_covariance(bundle, Scale("none")).matrix
    assert (
        np.linalg.matrix_rank(covariance, tol=1e-9 * np.trace(covariance), hermitian=True)
        == bundle.size - 7
    )
    # a generalised inverse, to the rounding of numbers that differ by 1e4 between metres and
    # radians
    for a, b in ((information, covariance), (covariance, information)):
        np.testing.assert_allclose(a @ b @ a, a, atol=1e-8 * np.abs(a).max())


def test_known_poses_hold_the_frame_to_what_they_miss():
    """The mean of five centres, each known to 2 mm along each axis, is known to 2/√5 mm: no feature
    tells of it."""
    scene = noisy_model()
    bundle = Bundle(scene.model, {}, {})
    known = camera_covariance(bundle, Scale("poses", 5, 5, 2e-3))
    # the centre −Rᵀt moves by −Rᵀτ, and not by ω, which turns both t and R
    by_tau = [-image.cam_from_world().rotation.matrix().T / 5 for image in bundle.images]
    mean = np.zeros((3, bundle.size))
    for image, slope in zip(bundle.images, by_tau, strict=True):
        mean[:, known.places[image.name][:3]] = slope
    np.testing.assert_allclose(mean @ known.matrix @ mean.T, 2e-3**2 / 5 * np.eye(3), atol=1e-10)
    free = camera_covariance(bundle, Scale("model"))
    assert np.trace(free.matrix) < np.trace(known.matrix)


def test_a_point_moves_to_where_the_rays_of_the_moved_cameras_meet():
    """Of one certain movement; the shift is linear to 1e-6 of itself, the step over the
    distance."""
    scene = noisy_model(noise=0, off=0)
    bundle = Bundle(scene.model, scene.corners, scene.corners_m, (0, 4))
    point_m, images = np.array([0.03, -0.05, 0.04]), bundle.images
    pixels = [project(image, point_m[None])[0] for image in images]
    for seen in (np.ones(5, bool), np.array([True, False, False, True, False])):
        shown = [image for image, s in zip(images, seen, strict=True) if s]
        step = np.random.default_rng(0).normal(0, 1e-6, bundle.size)
        known = CameraCovariance(np.outer(step, step), bundle.place, (0, 4))
        [covariance] = point_covariance(images, known, point_m[None], seen[None])
        state = bundle.state()
        bundle.move(step, np.zeros((40, 3)))
        chosen = [p for p, s in zip(pixels, seen, strict=True) if s]
        shift_m = meeting_point(shown, chosen, point_m) - point_m
        bundle.restore(state)
        np.testing.assert_allclose(
            covariance, np.outer(shift_m, shift_m), atol=1e-4 * (shift_m @ shift_m)
        )
