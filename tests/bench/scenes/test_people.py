"""People's hands: the mean one unchanged, sizes as published, one sound body each, letters held
with own bones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handbench.bench.scenes.bones import person_pose, skeleton
from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.bench.scenes.people import LENGTHS_MM, MEAN, MOST_PEOPLE, person, placement
from tests.bench.scenes.hand_field import hand_field
from tests.bench.scenes.test_letters import clearance_m

COARSE_M = 6e-3
NUMBERS = st.integers(1, MOST_PEOPLE)
# Distances of the mean hand in F at twelve points, as they were before there were people.
MEAN_FIELD_M = [
    0.017430703367893815, 0.03689373710735503, -0.0064881080629444745, 0.02655924408285347,
    0.014723805853623467, 0.010267177443583242, 0.0020829567570510438, 0.007575372802106011,
    0.016974683127993127, 0.013048101497297244, 0.012818539582531095, 0.0025444557781961145,
]  # fmt: skip


def test_the_mean_hand_is_what_it_was() -> None:
    assert person(0) is MEAN and person_pose(POSES["F"], 0) is POSES["F"]
    points_m = np.random.default_rng(0).uniform((-0.06, -0.09, -0.04), (0.06, 0.12, 0.03), (12, 3))
    # the same bits, but for another processor's square roots
    assert np.abs(hand_field(POSES["F"])(points_m) - MEAN_FIELD_M).max() < 1e-16


@given(NUMBERS)
def test_a_person_is_a_person_again_and_no_other(number: int) -> None:
    drawn = person.__wrapped__(number)
    assert drawn == person(number) != person(number % MOST_PEOPLE + 1)
    held, again, other = (np.concatenate(placement(number, seed)) for seed in (3, 3, 4))
    assert (held == again).all() and (held != other).all()


def test_sizes_and_proportions_are_the_published_ones() -> None:
    """Both sexes of the 1988 survey together; the tails that are cut take a tenth of the deviation
    within each. Bones as Buryanov & Kotiuk: 0.08 to 0.15, with the radiographs' error."""
    people = [person(number) for number in range(1, 801)]
    bones = {n: np.array(own) * [p.bones[n] for p in people] for n, own in LENGTHS_MM.items()}
    breadth, length, _ = np.transpose([p.palm for p in people])
    palm_mm = 189.2 - sum(LENGTHS_MM["middle"][1:])
    length_mm = palm_mm * length + bones["middle"][:, 1:].sum(axis=1)
    breadth_mm = 83.4 * breadth
    assert length_mm.mean() == pytest.approx((193.8 + 180.5) / 2, abs=1.5)
    assert np.hypot(9.75 * 0.9, 6.65) == pytest.approx(length_mm.std(), rel=0.12)
    assert breadth_mm.mean() == pytest.approx((90.4 + 79.4) / 2, abs=1)
    assert np.hypot(4.0 * 0.9, 5.5) == pytest.approx(breadth_mm.std(), rel=0.1)
    assert 0.6 < np.corrcoef(length_mm, breadth_mm)[0, 1] < 0.9
    spread = np.concatenate([own.std(axis=0) / own.mean(axis=0) for own in bones.values()])
    assert spread.min() > 0.05 and spread.max() < 0.12


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(NUMBERS, st.sampled_from("BFUAY"))
def test_every_person_has_one_sound_hand(number: int, letter: str) -> None:
    own, pose = person(number), person_pose(POSES[letter], number)
    surface = hand_mesh(pose, COARSE_M, own)
    assert surface.is_edge_manifold(allow_boundary_edges=False)
    assert len(surface.cluster_connected_triangles()[1]) == 1
    assert 1.5e-4 < surface.get_volume() < 7e-4
    digits = skeleton(pose, own).values()
    joints = np.array([p for digit in digits for b in digit for p in (b.start_m, b.end_m)])
    assert hand_field(pose, own)(joints).max() < -5e-4


@pytest.mark.parametrize("number", [2, 12, 66, 177])
@pytest.mark.parametrize(("letter", "finger"), [("F", "index"), ("U", "ring"), ("O", "middle")])
def test_digits_that_touch_in_a_letter_touch_in_every_hand(
    letter: str, finger: str, number: int
) -> None:
    mean_m, _ = clearance_m(POSES[letter], "thumb", finger)
    own_m, _ = clearance_m(person_pose(POSES[letter], number), "thumb", finger, person(number))
    assert own_m == pytest.approx(mean_m, abs=1e-3)


def test_a_hand_that_is_larger_by_one_factor_is_the_mean_hand_scaled() -> None:
    """Places and radii all follow: nothing of palm, thumb and wrist was left behind but blends and
    pads of a few mm."""
    scale, at_m = 1.15, np.asarray(hand_mesh(Pose(), 6e-3).vertices)
    large = replace(
        MEAN, palm=(scale,) * 3, bones={n: (scale,) * len(own) for n, own in LENGTHS_MM.items()},
        girth=dict.fromkeys(LENGTHS_MM, scale),
    )  # fmt: skip
    off_m = np.abs(hand_field(Pose(), large)(scale * at_m))
    assert off_m.max() < 2e-3 and off_m.mean() < 3e-4
