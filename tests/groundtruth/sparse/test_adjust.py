"""Bundle adjustment with the board in it, on synthetic cameras with seeded noise."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from handbench.groundtruth.cameras.cameras import load_pycolmap, registered_images
from handbench.groundtruth.sparse.adjust import adjust, camera_covariance
from handbench.groundtruth.sparse.bundle import Bundle
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.jacobians import pixel_jacobians, project
from tests.groundtruth.noisy_model import FEATURE_PX, PARAMS, noisy_model, poses_of

DISTORTION, INTRINSICS = (4, 5, 6, 7), tuple(range(8))


def adjusted(scene, free=()):
    """The bundle after the adjustment, and the standard deviations [d] of its parameters."""
    adjust(scene.model, scene.corners, scene.corners_m, free)
    bundle = Bundle(scene.model, scene.corners, scene.corners_m, free)
    return bundle, np.sqrt(np.diag(camera_covariance(bundle, Scale("board")).matrix))


@pytest.mark.parametrize("free", [(), DISTORTION, INTRINSICS])
def test_poses_and_intrinsics_come_back(free):
    scene = noisy_model(1, off=5e-3)
    before = np.abs(scene.error(Bundle(scene.model, scene.corners, scene.corners_m, free)))
    bundle, sigma = adjusted(scene, free)
    after = np.abs(scene.error(bundle))
    assert (before[:30] / sigma[:30]).mean() > 4  # there is something to do
    assert (
        after / sigma
    ).max() < 4.5  # of 70 numbers at most, one is beyond 4.5 σ once in 2000 scenes
    assert (
        np.abs(
            np.array([p.xyz for _, p in sorted(scene.model.points3D.items())]) - scene.points_m
        ).max()
        < 2e-3
    )


@pytest.mark.parametrize(
    ("free", "params"), [((), PARAMS), (INTRINSICS, (440, 440, 200, 150, 0, 0, 0, 0))]
)
def test_without_noise_nothing_is_left(free, params):
    """With free intrinsics only for a lens as the priors expect it: they are the one thing that
    pulls."""
    scene = noisy_model(noise=0, off=5e-3, params=params)
    bundle, sigma = adjusted(scene, free)
    assert (
        np.abs(scene.error(bundle)) / sigma
    ).max() < 1e-6  # the last step's square, where σ is that of 0.03 px


def test_a_step_moves_the_pixels_as_the_jacobians_say():
    scene = noisy_model()
    bundle = Bundle(scene.model, scene.corners, scene.corners_m, INTRINSICS)
    random = np.random.default_rng(0)
    step = random.normal(0, 1e-6, bundle.size)
    points_step = random.normal(0, 1e-6, (40, 3))
    expected, before = {}, bundle.state()
    for image in bundle.images:
        by_point, by_camera = pixel_jacobians(image, before[2], INTRINSICS)
        moved = (
            np.einsum("nij,nj->ni", by_point, points_step)
            + by_camera @ step[bundle.place[image.name]]
        )
        expected[image.name] = project(image, before[2]) + moved
    bundle.move(step, points_step)
    for image in bundle.images:
        found = project(image, before[2] + points_step)
        np.testing.assert_allclose(
            found, expected[image.name], atol=1e-7
        )  # second order: 1e-12 × 440 px and less
    bundle.restore(before)
    for now, then in zip(bundle.state()[0], before[0], strict=True):
        np.testing.assert_array_equal(now.matrix(), then.matrix())
    np.testing.assert_array_equal(bundle.state()[2], before[2])


def test_the_right_side_is_the_slope_of_the_cost():
    """Of half the cost, downhill, with Cauchy's weights and the lens's priors; by differences."""
    scene = noisy_model(3)
    bundle = Bundle(scene.model, scene.corners, scene.corners_m, INTRINSICS)
    equations = bundle.normal()
    random = np.random.default_rng(0)
    for scale in (np.eye(bundle.size)[0], np.eye(bundle.size)[40], random.normal(size=bundle.size)):
        step = 1e-7 * scale / np.linalg.norm(scale)
        costs = []
        for sign in (1, -1):
            before = bundle.state()
            bundle.move(sign * step, np.zeros((40, 3)))
            costs.append(bundle.normal(jacobians=False).cost)
            bundle.restore(before)
        assert (costs[1] - costs[0]) / 4 == pytest.approx(equations.right @ step, rel=1e-4)


def test_eliminating_the_points_leaves_the_same_step():
    """The one that all equations together have."""
    scene = noisy_model(3)
    equations = Bundle(scene.model, scene.corners, scene.corners_m, INTRINSICS).normal()
    matrix, right, inverse = equations.reduced(0.0)
    step = np.linalg.solve(matrix, right)
    (d, p), blocks = (len(right), len(inverse)), np.zeros((120, 120))
    for i in range(p):
        blocks[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = equations.points[i]
    coupling = np.moveaxis(equations.coupling, 1, 0).reshape(d, 3 * p)
    whole = np.block([[equations.cameras, coupling], [coupling.T, blocks]])
    expected = np.linalg.solve(whole, np.r_[equations.right, equations.points_right.ravel()])
    np.testing.assert_allclose(step, expected[:d], atol=1e-6 * np.abs(expected[:d]).max())
    at = np.einsum(
        "pij,pj->pi",
        inverse,
        equations.points_right - np.einsum("pdi,d->pi", equations.coupling, step),
    )
    np.testing.assert_allclose(at.ravel(), expected[d:], atol=1e-6 * np.abs(expected[d:]).max())


def test_known_intrinsics_stay_bit_for_bit():
    scene = noisy_model()
    adjusted(scene)
    for camera in scene.model.cameras.values():
        assert tuple(camera.params) == PARAMS
    scene = noisy_model()
    adjusted(scene, DISTORTION)
    for camera in scene.model.cameras.values():
        assert tuple(camera.params[:4]) == PARAMS[:4] and (camera.params[4:] != PARAMS[4:]).all()


def test_one_camera_of_all_photographs_has_one_set_of_columns():
    own, shared = noisy_model(), noisy_model(shared=True)
    apart, apart_sigma = adjusted(own, INTRINSICS)
    together, together_sigma = adjusted(shared, INTRINSICS)
    assert (apart.size, together.size) == (5 * 6 + 5 * 8, 5 * 6 + 8)
    for columns in together.place.values():
        np.testing.assert_array_equal(columns[6:], np.arange(30, 38))
    assert len({tuple(columns) for columns in together.place.values()}) == 5
    assert len({int(c) for columns in apart.place.values() for c in columns}) == apart.size
    # five photographs instead of one, and poses that share what is not known: 1/√5 at most
    assert together_sigma[30:38].max() < apart_sigma[30:38].max() / 5**0.5
    assert (np.abs(shared.error(together)) / together_sigma).max() < 4.5


def false_features(scene):
    """Add 30 crossings that two neighbours show and that are nowhere, all 3 px to the right in the
    second."""
    colmap = load_pycolmap()
    images = {image.name: image for image in registered_images(scene.model)}
    false_m = np.random.default_rng(5).uniform(-0.1, 0.1, (30, 3))
    for point in false_m:
        elements = []
        for name, right_px in (("p1.png", 0.0), ("p2.png", 3.0)):
            image = images[name]
            image.points2D.append(colmap.Point2D(project(image, point[None])[0] + (right_px, 0)))
            elements.append(colmap.TrackElement(image.image_id, len(image.points2D) - 1))
        scene.model.add_point3D(point, colmap.Track(elements), np.zeros(3, np.uint8))


def test_false_features_of_two_photographs_bend_nothing():
    clean, scene = noisy_model(), noisy_model()
    false_features(scene)
    assert scene.model.num_points3D() == 70
    adjusted(clean)
    adjusted(scene)
    np.testing.assert_array_equal(poses_of(scene.model), poses_of(clean.model))


def test_of_three_photographs_two_suffice_and_what_is_left_out_follows():
    scene = noisy_model(views=3, seen_by=2)
    assert len(Bundle(scene.model, scene.corners, scene.corners_m).points) == 40
    scene = noisy_model(views=5, seen_by=2, noise=0.01, off=5e-3)
    bundle, _ = adjusted(scene)
    assert not bundle.points and not bundle.features
    points_m = np.array([p.xyz for _, p in sorted(scene.model.points3D.items())])
    # 4 µrad of noise from 0.6 m at 17° between neighbours is some 20 µm, a few times that in one of
    # 40
    assert np.abs(points_m - scene.points_m).max() < 2e-4


def test_corners_that_are_wrong_are_outvoted():
    """Three of a hundred, 3 px off, sixty times their noise; poses move by less than their standard
    deviation."""
    clean, scene = noisy_model(2), noisy_model(2)
    for name, corner in (("p0.png", (0, 0)), ("p2.png", (3, 1)), ("p4.png", (4, 2))):
        scene.corners[name][corner] = scene.corners[name][corner] + (3.0, -3.0)
    expected, sigma = adjusted(clean)
    bundle, _ = adjusted(scene)
    assert (np.abs(scene.error(bundle) - clean.error(expected)) / sigma).max() < 1
    assert bundle.known[0].noise_px == pytest.approx(expected.known[0].noise_px, rel=0.15)


def test_the_order_of_the_points_does_not_matter():
    """But for rounding: of the sums, and of where a relative fall of 1e-6 ends the descent."""
    one, other = noisy_model(), noisy_model()
    colmap = load_pycolmap()
    content = [
        (p.xyz.copy(), colmap.Track(list(p.track.elements)))
        for _, p in sorted(other.model.points3D.items())
    ]
    for number in list(other.model.points3D):
        other.model.delete_point3D(number)
    for xyz, track in reversed(content):
        other.model.add_point3D(xyz, track, np.zeros(3, np.uint8))
    other.corners.update(
        {name: dict(reversed(found.items())) for name, found in reversed(other.corners.items())}
    )
    adjusted(one)
    adjusted(other)
    np.testing.assert_allclose(poses_of(other.model), poses_of(one.model), atol=1e-11)


def test_the_number_of_blas_threads_changes_nothing():
    found = []
    for threads in (1, 2):
        scene = noisy_model(points=200)  # so many that BLAS divides the products
        with threadpool_limits(threads):
            adjusted(scene)
        found.append(poses_of(scene.model))
    np.testing.assert_array_equal(*found)


def test_a_photograph_of_nothing_stays_and_a_point_behind_counts_for_nothing():
    scene = noisy_model()
    for point in list(scene.model.points3D.values()):
        [element] = [e for e in point.track.elements if e.image_id == 5]
        scene.model.delete_observation(5, element.point2D_idx)
    scene.corners["p4.png"] = {}
    scene.model.points3D[1].xyz = np.array([0.0, 0.0, 3.0])  # behind all cameras
    before = poses_of(scene.model)
    bundle, sigma = adjusted(scene)
    np.testing.assert_allclose(poses_of(scene.model)[4], before[4], atol=1e-15)
    assert (np.abs(scene.error(bundle)) / np.where(sigma > 0, sigma, np.inf))[:24].max() < 4.5
    assert all(np.isfinite(seen.noise_px) and len(seen.pixels) == 39 for seen in bundle.features)


def test_noise_is_told_from_what_is_left():
    """A point's three coordinates fit three tenths of what five views say of it, and a median of
    800 numbers is 4 % off; below the floor nothing is believed."""
    scene = noisy_model(points=80)
    bundle, _ = adjusted(scene)
    assert 0.7**0.5 - 0.08 < bundle.features[0].noise_px / FEATURE_PX < 1.08
    scene = noisy_model(noise=0)
    bundle, _ = adjusted(scene)
    for seen in (*bundle.features, *bundle.known):
        assert 0.03 <= seen.noise_px < 0.04
