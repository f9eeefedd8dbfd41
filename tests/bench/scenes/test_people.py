"""People's hands: the mean one unchanged, sizes as published, one sound body each, letters held
with own bones."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.scenes.bones import person_pose
from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.bench.scenes.people import LENGTHS_MM, MEAN, MOST_PEOPLE, person, placement
from tests.bench.scenes.hand_field import hand_field

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


def test_a_person_is_a_person_again_and_no_other() -> None:
    assert person.__wrapped__(MOST_PEOPLE) == person(MOST_PEOPLE) != person(1)
    held, same, other = (np.concatenate(placement(1, seed)) for seed in (3, 3, 4))
    assert (held == same).all() and (held != other).all()


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
