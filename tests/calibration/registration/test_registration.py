"""Matching by distances, and the registration with its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.spheres.description import (
    Candidate,
    Element,
    Target,
    default_target,
    match,
)
from handbench.calibration.transforms import Transform, umeyama
from handbench.support.errors import HandbenchError
from tests.calibration.seen_target import ANY, align, candidates, pose, register
from tests.strategies import examples

seeds = st.integers(0, 2**32 - 1)


def placed(rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
    rotation, shift_m = pose(rng)
    return points @ rotation.T + shift_m


# --- matching
# -------------------------------------------------------------------------------------------------------


@given(seeds, st.integers(0, 4) | st.none(), st.integers(0, 12))
@examples(60)
def test_elements_are_recognised_in_any_order_and_pose(seed, missing, extra):
    """Any order and rotation, one corner or none missing (the fifth breaks the symmetry), strangers
    among them."""
    rng, target = np.random.default_rng(seed), default_target()
    centres = placed(rng, target.centres_m)
    seen = [i for i in range(5) if i != missing or i == 4]
    strangers = centres.mean(axis=0) + rng.uniform(-1, 1, (extra, 3)) * 0.3
    keep = np.linalg.norm(strangers[:, None] - centres[None], axis=2).min(axis=1) > 0.2
    everything = np.concatenate(
        [centres[seen] + 1e-4 * rng.standard_normal((len(seen), 3)), strangers[keep]]
    )
    order = rng.permutation(len(everything))
    found = match(candidates(everything[order]), target, "echoes")
    assert sorted(found) == seen
    for element, candidate in found.items():
        assert np.linalg.norm(candidate.centre_m - centres[element]) < 1e-3


def test_strangers_nearby_do_not_matter_when_their_distances_do_not_fit(rng, target):
    centres = placed(rng, target.centres_m)
    faces = centres + np.array([0, 0, 0.0225])  # weak echoes of the foam, nearer by R − a ...
    faces[4] = centres[4] + [0, 0, 0.0125]  # ... which is less for the small sphere
    found = match(candidates(np.concatenate([faces, centres])), target, "echoes")
    np.testing.assert_array_equal([found[i].centre_m for i in range(5)], centres)


@pytest.mark.parametrize(
    "build", [lambda t, s: (s, s.centres_m), lambda t, s: (t, t.centres_m[:4])]
)
def test_a_square_alone_is_never_guessed(rng, target, square, build):
    wanted, centres = build(target, square)
    with pytest.raises(
        HandbenchError, match=r"elements 1, 2, 3, 4 can be matched in 8 ways; use a target without"
    ):
        match(candidates(placed(rng, centres)), wanted, "echoes")


def test_two_candidates_for_one_element_are_never_guessed(rng, target):
    centres = placed(rng, target.centres_m)
    with pytest.raises(HandbenchError, match="in 2 ways"):
        match(candidates([*centres, centres[0] + [5e-4, 0, 0]]), target, "photographs")


def test_a_mirrored_target_is_refused(rng):
    tetrapod = Target(
        element=tuple(
            Element(centre_m=c, sphere_radius_m=0.02, ball_radius_m=0.002)
            for c in [(0.0, 0, 0), (0.1, 0, 0), (0.0, 0.13, 0), (0.0, 0, 0.17)]
        )
    )
    assert len(match(candidates(placed(rng, tetrapod.centres_m)), tetrapod, "echoes")) == 4
    with pytest.raises(
        HandbenchError, match=r"echoes: \d of 4 candidates lie as the target's elements do"
    ):
        match(candidates(placed(rng, tetrapod.centres_m * [1, 1, -1])), tetrapod, "echoes")


def test_size_decides_which_elements_a_candidate_can_be(rng, target):
    centres = placed(rng, target.centres_m)
    wrong = [*candidates(centres[:4], (4,)), *candidates(centres[4:], (0, 1, 2, 3))]
    with pytest.raises(HandbenchError, match="expected at least 4 of 5"):
        match(wrong, target, "photographs")


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_candidates_are_refused(rng, target, count):
    with pytest.raises(HandbenchError, match="expected at least 4 of 5"):
        match(candidates(placed(rng, target.centres_m)[:count]), target, "photographs")


def test_a_cloud_in_the_wrong_unit_is_refused(rng, target):
    with pytest.raises(HandbenchError, match="check the target's description, the scale"):
        match(candidates(1000 * placed(rng, target.centres_m)), target, "photographs")


def test_many_strangers_take_no_long_search(rng, target):
    """80 candidates with a planted target: pruning by distances leaves few branches."""
    centres = placed(rng, target.centres_m)
    crowd = centres.mean(axis=0) + rng.uniform(-0.3, 0.3, (75, 3))
    found = match(candidates(np.concatenate([crowd, centres])), target, "echoes")
    np.testing.assert_array_equal([found[i].centre_m for i in range(5)], centres)


# --- registration
# ---------------------------------------------------------------------------------------------------


@given(seeds, st.booleans())
@examples(40)
def test_exact_centres_give_the_exact_transform(seed, with_scale):
    rng, target = np.random.default_rng(seed), default_target()
    scale = rng.uniform(0.995, 1.005) if with_scale else 1.0
    optical = placed(rng, target.centres_m)
    rotation, shift_m = pose(rng)
    radar = scale * optical @ rotation.T + shift_m
    found = register(candidates(optical), candidates(radar[::-1]), target, with_scale)
    np.testing.assert_allclose(found.matrix[:3, :3], scale * rotation, atol=1e-9)
    np.testing.assert_allclose(found.matrix[:3, 3], shift_m, atol=1e-9)
    assert (found.source, found.target) == ("photo", "radar")
    assert found.covariance.shape == ((7, 7) if with_scale else (6, 6))
    assert found.residuals_m.max() < 1e-9


def test_only_common_elements_count(rng, target):
    optical, radar = placed(rng, target.centres_m), placed(rng, target.centres_m)
    found = register(
        candidates(np.delete(optical, 0, 0)), candidates(np.delete(radar, 2, 0)), target
    )
    np.testing.assert_allclose(found.points(optical), radar, atol=1e-9)
    assert len(found.residuals_m) == 3


def test_elements_on_a_line_are_refused(rng):
    line = np.array([[0, 0, 0], [0.05, 0, 0], [0.12, 0, 0], [0.2, 1e-4, 0]])
    with pytest.raises(
        HandbenchError, match="lie on a line, so that the rotation about it stays open"
    ):
        align(candidates(line), candidates(placed(rng, line)))
    with pytest.raises(HandbenchError, match="share 2 elements; expected 3 or more"):
        align(candidates(line[:2]), candidates(line[:2]))


def ellipsoid(rng: np.random.Generator) -> np.ndarray:
    root = rng.standard_normal((3, 3))
    return 1e-8 * (root @ root.T + 0.1 * np.eye(3))


def measured(
    rng: np.random.Generator, centres: np.ndarray, covariances: list[np.ndarray]
) -> list[Candidate]:
    """Candidates that err by their own covariances."""
    return [
        Candidate(rng.multivariate_normal(c, s), s, ANY)
        for c, s in zip(centres, covariances, strict=True)
    ]


@pytest.mark.parametrize("with_scale", [False, True])
def test_the_covariance_is_honest(rng, target, with_scale):
    """Over 400 registrations of centres that err by their own covariances, the normalised squared
    errors of the transform and of a carried point average 6 (or 7) and 3. The standard error of a
    mean of χ²ₙ is √(2n/400); four of them, and 3 % for the 1 % of trials whose covariance is
    enlarged."""
    unknowns, trials = (7 if with_scale else 6), 400
    true_p = placed(rng, target.centres_m)
    rotation, shift_m = pose(rng)
    true_q = true_p @ rotation.T + shift_m
    truth = Transform("photo", "radar", umeyama(true_p, true_q))
    far = true_q.mean(axis=0) + np.array([0.05, -0.08, 0.1])
    p_cov, q_cov = ([ellipsoid(rng) for _ in true_p] for _ in range(2))
    nees, point_nees = [], []
    for _ in range(trials):
        found = align(measured(rng, true_p, p_cov), measured(rng, true_q, q_cov), with_scale)
        step = log_error(found, truth)[:unknowns]
        nees.append(step @ np.linalg.solve(found.covariance, step))
        miss = found.points(truth.inverse().points(far)) - far
        point_nees.append(miss @ np.linalg.solve(found.point_covariance(far), miss))
    assert np.mean(nees) == pytest.approx(
        unknowns, abs=4 * np.sqrt(2 * unknowns / trials) + 0.03 * unknowns
    )
    assert np.mean(point_nees) == pytest.approx(3, abs=4 * np.sqrt(6 / trials) + 0.09)
    assert np.mean(np.array(nees) < chi2.ppf(0.9, unknowns)) == pytest.approx(
        0.9, abs=4 * np.sqrt(0.09 / trials)
    )


@given(seeds, st.booleans())
@examples(4)
def test_the_covariance_is_honest_over_poses_and_covariances(seed, with_scale):
    """150 registrations, each with a target, a pose and covariances of its own: the mean of χ²ₙ
    within five of its standard errors, and 5 % for the enlarged ones and for what is beyond first
    order."""
    rng, trials, unknowns = np.random.default_rng(seed), 150, 7 if with_scale else 6
    nees = []
    for _ in range(trials):
        true_p = default_target().centres_m + 0.03 * rng.uniform(-1, 1, (5, 3))
        true_q = placed(rng, true_p)
        truth = Transform("photo", "radar", umeyama(true_p, true_q))
        p_cov, q_cov = ([ellipsoid(rng) for _ in true_p] for _ in range(2))
        found = align(measured(rng, true_p, p_cov), measured(rng, true_q, q_cov), with_scale)
        step = log_error(found, truth)[:unknowns]
        nees.append(step @ np.linalg.solve(found.covariance, step))
    assert np.mean(nees) == pytest.approx(
        unknowns, abs=5 * np.sqrt(2 * unknowns / trials) + 0.05 * unknowns
    )


@pytest.mark.parametrize(("deviations", "share"), [(3, 0.75), (6, 0.75), (10, 0.9), (1000, 0.9)])
def test_the_covariance_with_one_wrong_pair_in_five(rng, target, deviations, share):
    """Share of 200 trials in which the 95 % ellipsoid holds the error 50 mm before the target (a
    standard error is 1.5 %, at 84 % 2.6 %). Far off, the pair is left out and the covariance is
    that of the others. Three deviations cannot be told from chance, and six are weighed down and
    enlarge the covariance, but not by all that they did: 83 %."""
    inside = []
    point_m = np.array([0, 0, 0.05])
    for _ in range(200):
        p, q = (target.centres_m + 1e-4 * rng.standard_normal((5, 3)) for _ in range(2))
        way = rng.standard_normal(3)
        q[rng.integers(5)] += deviations * np.sqrt(2) * 1e-4 * way / np.linalg.norm(way)
        found = align(candidates(p), candidates(q))
        miss = found.points(point_m) - point_m
        inside.append(
            miss @ np.linalg.solve(found.point_covariance(point_m), miss) < chi2.ppf(0.95, 3)
        )
    assert np.mean(inside) > share


def log_error(found: Transform, truth: Transform) -> np.ndarray:
    """[translation, rotation, log scale] that carries the true transform to the one found, to first
    order."""
    change = found.matrix @ np.linalg.inv(truth.matrix)
    scale = np.cbrt(np.linalg.det(change[:3, :3]))
    skew = (change[:3, :3] / scale - (change[:3, :3] / scale).T) / 2
    return np.array([*change[:3, 3], skew[2, 1], skew[0, 2], skew[1, 0], np.log(scale)])


def test_the_better_known_centres_weigh_more(rng, target):
    p = placed(rng, target.centres_m)
    q = p.copy()
    q[0] += [0.001, 0, 0]
    bad = candidates(q, covariance_m2=1e-8 * np.eye(3))
    bad[0] = candidates(q[:1], covariance_m2=1e-4 * np.eye(3))[0]
    assert align(candidates(p, covariance_m2=1e-12 * np.eye(3)), bad).residuals_m[1:].max() < 1e-6


def test_an_outlier_is_resisted_and_widens_the_covariance(rng, target):
    p = placed(rng, target.centres_m)
    q = p + 5e-5 * rng.standard_normal(p.shape)
    good = align(candidates(p), candidates(q))
    q[2] += [0.0015, 0, 0]  # 10 standard deviations, yet within the tolerance of the matching
    robust = register(candidates(p), candidates(q), target)
    plain = Transform("photo", "radar", umeyama(p, q))
    assert np.abs(robust.points(p) - p).max() < 0.7 * np.abs(plain.points(p) - p).max()
    assert robust.residuals_m.argmax() == 2
    assert np.trace(robust.covariance) > 4 * np.trace(good.covariance)


def test_an_error_that_all_balls_share_widens_the_translation_alone(rng, target):
    p = placed(rng, target.centres_m)
    plain, shared = (
        register(candidates(p), candidates(p), target, common_m2=c)
        for c in (None, np.diag([0, 0, 1e-6]))
    )
    expected = np.zeros((6, 6))
    expected[2, 2] = 1e-6
    np.testing.assert_allclose(shared.covariance - plain.covariance, expected, atol=1e-15)
    np.testing.assert_array_equal(shared.matrix, plain.matrix)


@pytest.mark.parametrize("unit", [1.0, 0.5, 1e3])
def test_a_pair_s_weight_is_its_inverse_mean_variance_in_the_target_s_frame(unit):
    """Centres 0.1 m apart, the source in another unit: its variances are brought to metres first,
    where a scale is fitted, and taken as they are where none is."""
    centres_m = 0.1 * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1]])
    variances = np.array([1e-8, 2e-8, 3e-8, 4e-8])
    spread = [v[:, None, None] * np.eye(3) for v in (variances / unit**2, variances)]
    pairs = Pairs(centres_m / unit, centres_m, *spread, tuple("abcd"))
    np.testing.assert_allclose(pairs.weights(True), 1 / (2 * variances), rtol=1e-12)
    np.testing.assert_allclose(pairs.weights(False), 1 / (variances * (1 + unit**-2)), rtol=1e-12)
