"""The letters of the manual alphabet: the right fingers raised, contacts where asked for, no digit
inside another."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from handbench.bench.scenes.bones import (
    DIGITS,
    DISTAL,
    FINGERS,
    PALMAR,
    RADIAL,
    Bone,
    radii_m,
    skeleton,
    skeleton_of_palm,
)
from handbench.bench.scenes.hand import TIP_TISSUE_MM
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.bench.scenes.people import MEAN, Person
from tests.bench.scenes.hand_field import hand_field

CONTACT_M = 1.5e-3  # flesh gives way by this much where digits touch
# finger by finger from the index on: | raised, / raised but bent by up to 45°, . bent
RAISED = {
    "A": "....", "B": "||||", "C": "....", "D": "|...", "E": "....", "F": ".|||",
    "G": "|...", "H": "||..", "I": "...|", "K": "|/..", "L": "|...", "M": "....",
    "N": "....", "O": "....", "P": "|/..", "Q": "|...", "R": "//..", "S": "....",
    "T": "....", "U": "||..", "V": "||..", "W": "|||.", "X": "....", "Y": "...|",
}  # fmt: skip
TOUCHING = {
    **dict.fromkeys("AF", ("index",)),
    **dict.fromkeys("NOST", ("index", "middle")),
    **dict.fromkeys("KPX", ("middle",)),
    **dict.fromkeys("DM", ("middle", "ring")),
    **{"E": ("index", "middle", "ring"), "U": ("ring",), "W": ("little",)},
}
APART_M = {"C": 0.030, "G": 0.005, "L": 0.020, "Q": 0.005, "Y": 0.020}  # thumb from index, at least


def flesh(
    name: str, digit: tuple[Bone, ...], person: Person
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centres [n, 3] and radii [n] of balls along each phalanx, metres: an independent, plainer
    hand."""
    radius_m, balls, t = radii_m(name, person), [], np.linspace(0, 1, 20)
    for number, bone in enumerate(digit[1:]):
        tissue_m = 1e-3 * TIP_TISSUE_MM - radius_m[-1] if bone is digit[-1] else 0
        along_m = (bone.length_m + tissue_m) * t[:, None] * bone.axis
        balls.append((bone.start_m + along_m, np.interp(t, [0, 1], radius_m[number : number + 2])))
    return balls


def gaps_m(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Distances between the surfaces of balls [n] and balls [m]."""
    (a, ra), (b, rb) = one, other
    return np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb


def clearance_m(
    pose: Pose, one: str, other: str, person: Person = MEAN
) -> tuple[float, np.ndarray]:
    """Smallest distance between two digits' flesh, negative where they overlap, and the place. Webs
    do not count."""
    bones = skeleton(pose, person)
    neighbours = abs(DIGITS.index(one) - DIGITS.index(other)) == 1 and "thumb" not in (one, other)
    smallest, place = np.inf, np.zeros(3)
    for i, a in enumerate(flesh(one, bones[one], person)):
        for j, b in enumerate(flesh(other, bones[other], person)):
            gap = gaps_m(a, b)
            if neighbours and i == j == 0:
                gap[:8], gap[:, :8] = np.inf, np.inf
            k, m = np.unravel_index(gap.argmin(), gap.shape)
            if gap[k, m] < smallest:
                (p, p_m), (q, q_m) = (a[0][k], a[1][k]), (b[0][m], b[1][m])
                smallest, place = gap[k, m], (p * q_m + q * p_m) / (p_m + q_m)
    return smallest, place


def overlap_m(pose: Pose) -> float:
    """Greatest depth to which two digits, a fingertip and its base, or a tip and the metacarpals
    overlap."""
    bones = skeleton(pose)
    gaps = [clearance_m(pose, one, other)[0] for one, other in itertools.combinations(DIGITS, 2)]
    t = np.linspace(0, 0.9, 20)[:, None]
    metacarpals = (bones[name][0] for name in FINGERS)
    palm = np.concatenate([b.start_m + t * b.length_m * b.axis for b in metacarpals])
    for name in DIGITS:
        first, *_, last = balls = flesh(name, bones[name], MEAN)
        gaps.append(gaps_m(last, (palm, np.full(len(palm), 9e-3))).min())
        if name in FINGERS:
            gaps.append(gaps_m(first, balls[2]).min())
    return -min(gaps)


def test_pointing_letters_point_as_the_viewer_sees_them() -> None:
    """The thumb's side of an upright palm is the viewer's right. R's fingers cross, and V's are
    apart."""
    bones = {letter: skeleton(POSES[letter]) for letter in "CGHOPQRUV"}
    tips = {k: (of["index"][-1], of["middle"][-1]) for k, of in bones.items()}
    assert all(tips[letter][0].axis @ RADIAL > 0.9 for letter in "GH")
    assert all(tips[letter][0].axis @ -DISTAL > 0.7 for letter in "PQ")
    # the viewer sees the back of the hand, or a hand that is open to the right
    assert all(bones[letter]["middle"][0].palmar @ PALMAR < -0.7 for letter in "PQ")
    assert all(bones[letter]["middle"][0].palmar @ RADIAL > 0.6 for letter in "CO")
    across = {letter: middle.end_m - index.end_m for letter, (index, middle) in tips.items()}
    assert across["R"] @ RADIAL > 0.005 and across["R"] @ PALMAR < -0.005
    assert np.linalg.norm(across["U"]) < 0.025 and np.linalg.norm(across["V"]) > 0.040


@pytest.mark.parametrize("letter", POSES)
def test_letters_raise_the_right_fingers_and_no_digit_passes_through_another(letter: str) -> None:
    assert overlap_m(POSES[letter]) < CONTACT_M
    bones = skeleton_of_palm(POSES[letter])
    for name, raised in zip(FINGERS, RAISED[letter], strict=True):
        cosine = min(bones[name][-1].axis @ bones[name][1].axis, bones[name][1].axis @ DISTAL)
        assert cosine < 0.6 if raised == "." else cosine > {"|": 0.9, "/": 0.7}[raised], name


@pytest.mark.parametrize("letter", [*TOUCHING, *APART_M])
def test_the_thumb_touches_what_the_letter_asks_for_or_stays_away(letter: str) -> None:
    for finger in TOUCHING.get(letter, ()):
        gap_m, place_m = clearance_m(POSES[letter], "thumb", finger)
        assert abs(gap_m) < CONTACT_M, finger
        # the skin closes there, or nearly
        assert hand_field(POSES[letter])(place_m[None])[0] < 5e-4, finger
    if letter in APART_M:
        assert clearance_m(POSES[letter], "thumb", "index")[0] > APART_M[letter]
