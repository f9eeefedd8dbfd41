"""Matching by distances, and the registration with its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: candidates(c[:4]), "elements 1, 2, 3, 4 can be matched in 8 ways; use"),
        (lambda c: candidates([*c, c[0] + [5e-4, 0, 0]]), "in 2 ways"),
        (
            lambda c: [*candidates(c[:4], (4,)), *candidates(c[4:], (0, 1, 2, 3))],
            "expected at least 4 of 5",
        ),
        (lambda _: [], "expected at least 4 of 5"),
        (lambda c: candidates(c[:3]), "expected at least 4 of 5"),
        (lambda c: candidates(1000 * c), "check the target's description, the scale"),
    ],
)
def test_candidates_that_could_be_something_else_are_refused(rng, target, change, words):
    with pytest.raises(HandbenchError, match=words):
        match(change(placed(rng, target.centres_m)), target, "photographs")


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


@pytest.mark.slow
@given(seeds, st.booleans())
@examples(3)
def test_the_covariance_is_honest(seed, with_scale):
    """200 registrations, each with a target, a pose and covariances of its own: the normalised
    squared errors of the transform and of a carried point average 6 (or 7) and 3 within five of
    their standard errors, and 5 % for the enlarged covariances and for what is beyond first
    order."""
    rng, trials, unknowns = np.random.default_rng(seed), 200, 7 if with_scale else 6
    nees = []
    for _ in range(trials):
        true_p = default_target().centres_m + 0.03 * rng.uniform(-1, 1, (5, 3))
        true_q = placed(rng, true_p)
        truth = Transform("photo", "radar", umeyama(true_p, true_q))
        far = true_q.mean(axis=0) + np.array([0.05, -0.08, 0.1])
        p_cov, q_cov = ([ellipsoid(rng) for _ in true_p] for _ in range(2))
        found = align(measured(rng, true_p, p_cov), measured(rng, true_q, q_cov), with_scale)
        step = log_error(found, truth)[:unknowns]
        miss = found.points(truth.inverse().points(far)) - far
        pairs = (step, found.covariance), (miss, found.point_covariance(far))
        nees.append([e @ np.linalg.solve(covariance, e) for e, covariance in pairs])
    for mean, freedom in zip(np.mean(nees, axis=0), (unknowns, 3), strict=True):
        assert mean == pytest.approx(freedom, abs=5 * np.sqrt(2 * freedom / trials) + freedom / 20)


def log_error(found: Transform, truth: Transform) -> np.ndarray:
    """[translation, rotation, log scale] that carries the true transform to the one found, to first
    order."""
    change = found.matrix @ np.linalg.inv(truth.matrix)
    scale = np.cbrt(np.linalg.det(change[:3, :3]))
    skew = (change[:3, :3] / scale - (change[:3, :3] / scale).T) / 2
    return np.array([*change[:3, 3], skew[2, 1], skew[0, 2], skew[1, 0], np.log(scale)])


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
