"""Hard cases of registration: centres nearly on a line, mirror images, symmetry, wrong pairs; and
of the target's spheres: caps that shrink in photographs, balls that draw together in echoes; and of
a board with wrong corners.

Pairs fit exactly unless a case is about their errors, so that the transform that made them is the
reference.
"""

import io
from contextlib import redirect_stderr
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.calibration.ball_fit import fit_balls
from handbench.calibration.optical_detection import fit_sphere
from handbench.calibration.registration import GROSS
from handbench.calibration.target import Candidate, Element, Target, default_target, match
from handbench.groundtruth.sparse.frame import TRIM, trimmed_similarity
from handbench.radar.simulation.spheres import sphere_echo
from handbench.support.errors import HandbenchError
from tests.calibration.seen_target import align, candidates, cap
from tests.hard_cases.scenes import capture, small_array
from tests.references.balls import off, rotation
from tests.refusals import refuse

EPS = np.finfo(float).eps
SIGMA_M = 1e-4  # of a centre, per axis
HALF_M = 0.06  # of the target's square
SHIFT_M = np.array([0.1, -0.2, 0.3])
FIVE_M = default_target().centres_m
TURN = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()
RADIUS_M, RADIUS_SIGMA_M = 0.025, 5e-5
PARTS = (0.45, 0.3, 0.2, 0.15, 0.12, 0.1, 0.09, 0.08, 0.06, 0.03, 0.01)  # of a sphere that caps are
DENSITY_M2 = 6e5  # of a thinned cloud's points
TONES_HZ = np.linspace(72e9, 82e9, 16)
PLACE_M = np.array([0.01, -0.02, 0.3])
GAPS_M = (0.05, 0.02, 0.015, 0.012, 0.0101)  # between balls, which touch at 10 mm


def moved(points_m):
    return points_m @ TURN.T + SHIFT_M


def registered(source_m, target_m):
    """The product's transform, without what it says of pairs that it leaves out."""
    with redirect_stderr(io.StringIO()):
        return align(candidates(source_m), candidates(target_m))


def in_sigmas(error, covariance):
    """Length of an error in its own standard deviations."""
    return np.sqrt(error @ np.linalg.solve(covariance, error))


def normal_errors(count):
    """Distance, in σ, that the largest of so many normal errors of three coordinates exceeds once
    in a thousand sweeps."""
    return np.sqrt(chi2.isf(1e-3 / count, 3))


@pytest.mark.parametrize("ratio", [1, 2, 5, 10, 15, 19, 19.9])
def test_centres_nearly_on_a_line_turn_by_their_condition(ratio, within):
    """Against least squares of the same pairs, in balls. The worst axis turns κ times as far as the
    best one, which four roundings turn, across the half width; κ ≤ 20 is given."""
    half_m = HALF_M / ratio
    points_m = np.array([[x, y, 0] for x in (-HALF_M, HALF_M) for y in (-half_m, half_m)])
    moved_m, kappa = moved(points_m), np.hypot(HALF_M, half_m) / half_m
    apart = off(registered(points_m, moved_m).rotation, rotation(points_m, moved_m))
    off_rad = np.linalg.norm(apart) / np.sqrt(2)  # of matrices a small angle apart
    largest_m = max(np.abs(points_m).max(), np.abs(moved_m).max())
    within(off_rad, kappa * 4 * EPS * largest_m / HALF_M, "rad")


@pytest.mark.parametrize("height_m", [0, 1e-6, 1e-5, *np.logspace(-4, -1, 25)])
def test_a_mirror_image_is_refused_until_its_height_is_within_errors(height_m, within):
    """The pairs of a given transform must agree within the limit of a wrong pair; a plane is its
    own mirror image."""
    points_m = FIVE_M * [1, 1, 0]
    points_m[4, 2] = height_m
    try:
        transform = registered(points_m, moved(points_m * [1, 1, -1]))
    except HandbenchError:
        return
    within(max(transform.residuals_m) / (np.sqrt(2) * SIGMA_M), GROSS, "σ of a pair's distance")


@pytest.mark.parametrize("skew_m", [*np.linspace(0.02, 0.001, 20), 1e-4, 0.0])
def test_elements_of_a_target_that_grows_symmetric_are_never_exchanged(skew_m, within):
    """Two readings within the tolerance of 2 mm are refused, one beyond it is the right one."""
    places = (-HALF_M, 0.0, 0.0), (HALF_M, 0.0, 0.0), (skew_m / 2, 0.09, 0.0)
    radii = {"sphere_radius_m": 0.02, "ball_radius_m": 0.005}
    target = Target(element=tuple(Element(centre_m=place, **radii) for place in places))
    noise_m = SIGMA_M * np.random.default_rng(1).standard_normal((3, 3))
    moved_m = moved(target.centres_m) + noise_m
    try:
        matched = match(candidates(moved_m, (0, 1, 2)), target, "echoes")
    except HandbenchError:
        return
    wrong = [(c.centre_m != moved_m[element]).any() for element, c in matched.items()]
    within(sum(wrong), 0, "elements")


@pytest.mark.parametrize("size_m", np.logspace(-6, 6, 25))
def test_one_wrong_pair_in_five_pulls_no_further_than_it_is_believed(size_m, within):
    """A pair D σ off pulls by D of the transform's own σ at most, and D ≤ 10 is kept; the other
    four are exact."""
    for wrong in range(5):
        way = np.random.default_rng(wrong).standard_normal(3)
        moved_m = FIVE_M + SHIFT_M
        moved_m[wrong] += size_m * way / np.linalg.norm(way)
        found = registered(FIVE_M, moved_m)
        shift_m = found.matrix[:3, 3] - found.rotation @ SHIFT_M
        error = np.r_[shift_m, Rotation.from_matrix(found.rotation).as_rotvec()]
        place = f"pair {wrong + 1}"
        within(in_sigmas(error, found.require_covariance()), GROSS, "σ of the transform", place)


@pytest.mark.parametrize("noise_m", [0.0, 1e-4, 5e-4])
@pytest.mark.parametrize("part", PARTS)
def test_centres_of_spheres_of_which_a_cap_is_seen_are_covered(part, noise_m, within):
    """A normal error of one of the sweep's centres is beyond its σ once in a thousand sweeps (χ² of
    three); below 8 % none is given."""
    bound = normal_errors(6 * sum(part >= 0.08 for part in PARTS))
    for seed in range(2):
        rng = np.random.default_rng([seed, int(100 * part)])
        normals = cap(rng, RADIUS_M, part, DENSITY_M2)
        radii_m = RADIUS_M + RADIUS_SIGMA_M * rng.standard_normal()
        radii_m = radii_m + noise_m * rng.standard_normal((len(normals), 1))
        start_m = 1e-3 * np.array([1, -1, 1])
        found = fit_sphere(radii_m * normals, normals, start_m, RADIUS_M, RADIUS_SIGMA_M)
        assert found or part < 0.09
        assert not found or part > 0.07
        within(in_sigmas(*found) if found else 0.0, bound, "σ of the centre", f"draw {seed}")


@pytest.mark.parametrize("sigma_m", [0.0, RADIUS_SIGMA_M])
def test_points_that_lie_on_a_sphere_exactly_leave_no_residual(sigma_m, within):
    """Lengths, distances and residuals are exact in binary: nothing is left to fit, and nothing to
    divide by."""
    points_m = np.array(list(product(range(-9, 10), repeat=3)), float)
    points_m = points_m[(points_m**2).sum(axis=1) == 81] * 2.0**-9  # lengths without a rounding
    radius_m = 9 * 2.0**-9
    centre_m, covariance = fit_sphere(points_m, points_m / radius_m, np.zeros(3), radius_m, sigma_m)
    assert np.isfinite(covariance).all()
    within(np.linalg.norm(centre_m), 0, "m")


def fitted(gap_m, noise, off_m):
    """The errors and covariances of the fit to the echoes of two balls a gap apart, from places
    off_m away along each axis; noise: its power over the echoes'."""
    centres_m = PLACE_M + np.array([[0, 0, 0], [gap_m, 0, 0]])
    first, second = default_target().element[:2]
    target, rng = Target(element=(first, second, second)), np.random.default_rng(1)
    ball = first.ball_radius_m, target.foam_delay_m[0], TONES_HZ, small_array()
    samples = sum(sphere_echo(centre_m, *ball).astype(complex) for centre_m in centres_m)
    level = np.sqrt(noise * np.mean(np.abs(samples) ** 2) / 2)
    white = rng.standard_normal((2, *samples.shape))
    taken = capture(samples + level * (white[0] + 1j * white[1]), TONES_HZ)
    seeds = {i: Candidate(c + off_m, np.eye(3), (i,), c) for i, c in enumerate(centres_m)}
    balls = fit_balls(taken, target, seeds)
    return [(ball.centre_m - centres_m[i], ball.covariance_m2) for i, ball in balls.items()]


@pytest.mark.parametrize("noise", [1e-4, 1.0])
@pytest.mark.parametrize("gap_m", GAPS_M)
def test_centres_of_balls_that_draw_together_are_covered(gap_m, noise, within):
    """A normal error of one of the sweep's centres is beyond its σ once in a thousand sweeps (χ² of
    three)."""
    for one in fitted(gap_m, noise, off_m=1e-4):
        within(in_sigmas(*one), normal_errors(4 * len(GAPS_M)), "σ of a centre")


@pytest.mark.parametrize("gap_m", [0.0099, 0.005, 1e-3, 1e-5, 1e-7, 0.0])
def test_balls_nearer_than_their_radii_are_refused(gap_m):
    """Fitted all the same, they are off by 100 σ from 0.7 mm on."""
    refuse(lambda: fitted(gap_m, noise=0.01, off_m=0.0), "echoes", "1 and 2")


@pytest.mark.parametrize("size_m", np.logspace(-5, 4, 10))
@pytest.mark.parametrize("wrong", [slice(None, None, 5), slice(4)], ids=["apart", "a whole side"])
def test_one_board_corner_in_five_wrong_leaves_the_others(wrong, size_m, within):
    """Corners lie within 4 medians of the fit, the median within 2 of the majority's own, 1.54 σ:
    12.3 σ."""
    rng = np.random.default_rng(3)
    grid_m = [[x, y, 0] for x in np.linspace(-0.1, 0.1, 5) for y in np.linspace(-0.07, 0.07, 4)]
    way = rng.standard_normal((4, 3)) if wrong.step else np.array([[0.0, 0.0, 1.0]])
    source_m = grid_m + SIGMA_M * rng.standard_normal((20, 3))
    source_m[wrong] += size_m * way / np.linalg.norm(way, axis=1, keepdims=True)
    matrix = trimmed_similarity(source_m, np.array(grid_m), "board corners")[0]
    error_m = np.delete(grid_m @ matrix[:3, :3].T + matrix[:3, 3] - grid_m, wrong, axis=0)
    rms = np.sqrt((error_m**2).sum(axis=1).mean()) / SIGMA_M
    within(rms, TRIM * 2 * np.sqrt(chi2.median(3)), "σ of a corner")
