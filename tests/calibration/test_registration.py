"""Matching by distances, and the registration with its covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.calibration.registration import Pairs, common_pairs, solve
from handbench.calibration.target import Element, Target, default_target, match
from tests.calibration.seen_target import candidates, pose
from tests.refusals import refuse
from tests.strategies import examples

seeds = st.integers(0, 2**32 - 1)


def placed(rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
    rotation, shift_m = pose(rng)
    return points @ rotation.T + shift_m


@given(seeds, st.integers(0, 4) | st.none(), st.integers(0, 12))
@examples(40)
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


def test_a_mirrored_target_is_refused(rng):
    places = [(0.0, 0, 0), (0.1, 0, 0), (0.0, 0.13, 0), (0.0, 0, 0.17)]
    elements = [Element(centre_m=c, sphere_radius_m=0.02, ball_radius_m=0.002) for c in places]
    tetrapod = Target(element=tuple(elements))
    assert len(match(candidates(placed(rng, tetrapod.centres_m)), tetrapod, "echoes")) == 4
    mirrored = candidates(placed(rng, tetrapod.centres_m * [1, 1, -1]))
    refuse(lambda: match(mirrored, tetrapod, "echoes"), "echoes", "4 of 4")


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda c: candidates(c[:4]), "8 ways"),
        (lambda c: [*candidates(c[:4], (4,)), *candidates(c[4:], (0, 1, 2, 3))], "4 of 5"),
        (lambda _: [], "4 of 5"),
        (lambda c: candidates(c[:3]), "4 of 5"),
    ],
    ids=["symmetric", "other sizes", "nothing", "three"],
)
def test_candidates_that_could_be_something_else_are_refused(rng, target, change, place):
    seen = change(placed(rng, target.centres_m))
    refuse(lambda: match(seen, target, "photographs"), "photographs", place)


def captured(
    rng: np.random.Generator, target: Target, name: str, captures: int = 1, unseen=((), ())
) -> Pairs:
    """The target with exact spheres and balls, but the `unseen` of both sensors."""
    sides = (
        candidates(placed(rng, target.centres_m), covariance_m2=1e-12 * np.eye(3)) for _ in unseen
    )
    optical, radar = (
        {i: one for i, one in enumerate(side) if i not in missing}
        for side, missing in zip(sides, unseen, strict=True)
    )
    return common_pairs(optical, radar, target, name, captures)


def test_only_common_elements_count(rng, target):
    pairs = captured(rng, target, "a", unseen=((0,), (2,)))
    assert pairs.names.tolist() == [f"a, element {i}" for i in (2, 4, 5)]
    assert max(solve(pairs).residuals_m) < 1e-12


def test_an_error_that_all_balls_share_widens_the_translation_alone(rng, target):
    pairs, shared_m2 = captured(rng, target, "a"), np.diag([0, 0, 1e-6])
    plain, shared = solve(pairs), solve(pairs, shared_m2)
    expected = np.pad(shared_m2, (0, 3))
    np.testing.assert_allclose(shared.covariance - plain.covariance, expected, atol=1e-15)
    np.testing.assert_array_equal(shared.matrix, plain.matrix)


def test_several_captures_do_not_reduce_what_the_target_is_unsure_of(rng, target):
    unsure = target.model_copy(update={"ball_offset_sigma_m": 1e-3})
    spreads_m2 = []
    for count in (1, 4):
        captures = [captured(np.random.default_rng(3), unsure, "a", count)] * count
        found = solve(sum(captures[1:], captures[0]))
        middle_m = captures[0].target_m.mean(axis=0)
        spreads_m2.append(np.trace(found.point_covariance(middle_m)))
        assert len(found.residuals_m) == 5 * count
    assert spreads_m2[1] == pytest.approx(spreads_m2[0], rel=0.01)


def test_a_wrong_pair_is_named_with_its_capture(rng, target, capsys):
    monday, friday = (captured(rng, target, name, 2) for name in ("monday", "friday"))
    monday = replace(friday, names=monday.names, target_m=friday.target_m.copy())
    friday.target_m[3] += [0, 0.04, 0]
    solve(friday + monday)
    printed = capsys.readouterr().err
    assert "friday, element 4 is 40" in printed and "monday" not in printed
