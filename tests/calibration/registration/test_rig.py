"""Several captures of the target: combined, and whether the rig moved between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.calibration.registration.register import HAND_M, RigMotion, combine, motion, solve
from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.spheres.description import default_target
from handbench.calibration.transforms import Transform, identity
from handbench.support.errors import HandbenchError
from tests.calibration.seen_target import candidates, pose

SPREAD_M = 5e-5


def captured(
    rng: np.random.Generator,
    moved_m: tuple[float, ...] = (0, 0, 0),
    turned_rad: tuple[float, ...] = (0, 0, 0),
    shared_m: float = 0.0,
) -> Pairs:
    """The target somewhere near the hand, seen by a rig whose radar frame moved against the
    photographs' (about the hand's centre), with errors of 0.05 mm and one along z that all balls
    share."""
    rotation, _ = pose(rng)
    photo = default_target().centres_m @ rotation.T + HAND_M + rng.uniform(-0.02, 0.02, 3)
    radar = (photo - HAND_M) @ Rotation.from_rotvec(turned_rad).as_matrix().T + HAND_M + moved_m
    radar = radar + [0, 0, shared_m]
    sides = (side + SPREAD_M * rng.standard_normal(side.shape) for side in (photo, radar))
    return Pairs.of(*(candidates(side, covariance_m2=SPREAD_M**2 * np.eye(3)) for side in sides))


def test_a_wrong_pair_is_named_with_its_capture(rng, capsys):
    captures = [captured(rng) for _ in range(2)]
    captures[1].target_m[3] += [0, 0.04, 0]
    combine(captures, names=["monday", "friday"])
    assert "registration: friday, pair 4 is 40" in capsys.readouterr().err


def test_captures_between_which_the_rig_moved_are_not_combined(rng):
    captures = [captured(rng), captured(rng), captured(rng, moved_m=(0.002, 0, 0))]
    expected = (
        r"the rig moved between (first|second) and third: (1\.9|2)\S* mm at the hand's centre "
        r"\(95 % interval 1\.\S+ to 2\.\S+ mm; χ² = \S+ for 6 degrees of freedom, p = \S+\); "
        r"use only the captures before"
    )
    with pytest.raises(HandbenchError, match=expected):
        combine(captures, names=["first", "second", "third"])


@pytest.mark.slow
def test_a_rig_at_rest_is_seldom_reported_to_move(rng):
    """400 repeats. χ² averages 6 (four standard errors, and 3 % for covariances that the
    residuals enlarge); 1 % are false alarms, 10 of 400 being four standard errors and more."""
    repeats = [
        motion(solve(captured(rng, shared_m=1e-4)), solve(captured(rng, shared_m=1e-4)))
        for _ in range(400)
    ]
    assert np.mean([m.chi2 for m in repeats]) == pytest.approx(
        6, abs=4 * np.sqrt(2 * 6 / 400) + 0.03 * 6
    )
    assert sum(m.moved for m in repeats) <= 12
    assert (
        sum(m.interval_m[0] > 0 for m in repeats) <= 20
    )  # nothing moved: the interval starts at nothing in 95 %


@pytest.mark.parametrize("move", [{"moved_m": (3e-4, 0, 0)}, {"turned_rad": (0, 0, 0.005)}])
def test_a_shift_and_a_turn_are_each_seen(rng, move):
    """A turn about the hand's centre leaves that point where it was, and is seen all the same."""
    found = motion(solve(captured(rng)), solve(captured(rng, **move)))
    assert found.moved
    assert found.sentence.startswith("the rig moved between the first capture and the second: ")
    expected = [*move.get("moved_m", (0, 0, 0)), *move.get("turned_rad", (0, 0, 0))]
    assert (np.abs(found.step - expected) < 5 * np.sqrt(np.diag(found.covariance))).all()


def test_a_rig_at_rest_does_not_measurably_move(rng):
    found = motion(solve(captured(rng)), solve(captured(rng)))
    assert not found.moved
    assert "the rig did not measurably move between" in found.sentence


def test_transforms_that_cannot_be_compared_are_refused(rng):
    pairs = captured(rng)
    rigid = solve(pairs)
    similar = Transform("photo", "radar", rigid.matrix, np.eye(7))
    for other, words in (
        (similar, "the sizes 6 and 7; expected 6 and 6, or 7 and 7 with a scale"),
        (Transform("photo", "radar", np.eye(4)), "sizes 6 and 0"),
        (
            identity("radar"),
            "the second: is a transform from 'radar' to 'radar'; expected one from",
        ),
    ):
        with pytest.raises(HandbenchError, match=words):
            motion(rigid, other)
    exact = replace(rigid, covariance=np.zeros((6, 6)))
    with pytest.raises(HandbenchError, match="are zero in some direction"):
        motion(exact, exact)


def test_a_shift_may_reach_as_far_as_its_ellipsoids_longest_axis():
    """A shift of 5 mm along x, with σ of 1, 2 and 3 mm along x, y and z."""
    reach_m = 1e-3 * np.sqrt(chi2.ppf(0.95, 3))
    covariance = np.diag([1e-6, 4e-6, 9e-6, 1e-6, 1e-6, 1e-6])
    interval_m = RigMotion(np.array([5e-3, 0, 0, 0, 0, 0]), covariance, "a", "b").interval_m
    assert interval_m == pytest.approx((5e-3 - reach_m, 5e-3 + 3 * reach_m))
