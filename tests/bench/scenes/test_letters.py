"""The letters of the manual alphabet: the right fingers raised, contacts where asked for, no digit
inside another."""

import itertools

import numpy as np
import pytest

from handbench.bench.scenes.bones import (
    DISTAL,
    FINGERS,
    RADIAL,
    person_pose,
    radii_m,
    skeleton,
    skeleton_of_palm,
)
from handbench.bench.scenes.hand import TIP_TISSUE_MM
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.bench.scenes.people import MEAN, Person, person
from tests.bench.scenes.hand_field import one_body

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


def flesh(pose: Pose, person: Person = MEAN) -> dict[str, np.ndarray]:
    """Balls (x, y, z, radius) [phalanx, n, 4] along each digit, metres: an independent, plainer
    hand."""
    t, digits = np.linspace(0, 1, 20)[:, None], {}
    for name, (_, *phalanges) in skeleton(pose, person).items():
        radius_m, balls = radii_m(name, person), []
        tissue_m = [*[0.0] * (len(phalanges) - 1), 1e-3 * TIP_TISSUE_MM - radius_m[-1]]
        ends_m = zip(phalanges, tissue_m, radius_m, radius_m[1:], strict=False)
        for bone, beyond_m, start_m, end_m in ends_m:
            along_m = (bone.length_m + beyond_m) * t * bone.axis
            balls.append(np.hstack([bone.start_m + along_m, start_m + t * (end_m - start_m)]))
        digits[name] = np.array(balls)
    return digits


def gap_m(one: np.ndarray, other: np.ndarray) -> float:
    """Smallest distance between the surfaces of balls, negative where they overlap."""
    one, other = one.reshape(-1, 1, 4), other.reshape(-1, 4)
    apart_m = np.linalg.norm(one[..., :3] - other[:, :3], axis=2)
    return float((apart_m - one[..., 3] - other[:, 3]).min())


def overlap_m(pose: Pose) -> float:
    """Greatest depth to which two digits overlap. Webs do not count."""
    digits, gaps_m = flesh(pose), []
    for one, other in itertools.combinations(digits, 2):
        web = 8 * ((one, other) in itertools.pairwise(FINGERS))  # balls at the root
        a, b = digits[one].reshape(-1, 4), digits[other].reshape(-1, 4)
        gaps_m += [gap_m(a[web:], b), gap_m(a, b[web:])]
    return -min(gaps_m)


def thumb_gap_m(pose: Pose, finger: str, person: Person = MEAN) -> float:
    """Distance between the thumb and a finger."""
    digits = flesh(pose, person)
    return gap_m(digits["thumb"], digits[finger])


@pytest.mark.parametrize(
    ("letter", "direction"), [("G", RADIAL), ("H", RADIAL), ("P", -DISTAL), ("Q", -DISTAL)]
)
def test_pointing_letters_point_as_the_viewer_sees_them(letter: str, direction: np.ndarray) -> None:
    """The thumb's side of an upright palm is the viewer's right."""
    assert skeleton(POSES[letter])["index"][-1].axis @ direction > 0.7


@pytest.mark.parametrize("letter", POSES)
def test_letters_raise_the_right_fingers_and_no_digit_passes_through_another(letter: str) -> None:
    assert overlap_m(POSES[letter]) < CONTACT_M
    bones = skeleton_of_palm(POSES[letter])
    for name, raised in zip(FINGERS, RAISED[letter], strict=True):
        cosine = min(bones[name][-1].axis @ bones[name][1].axis, bones[name][1].axis @ DISTAL)
        assert cosine < 0.6 if raised == "." else cosine > {"|": 0.9, "/": 0.7}[raised], name


@pytest.mark.parametrize("letter", TOUCHING)
def test_the_thumb_touches_what_the_letter_asks_for(letter: str) -> None:
    for finger in TOUCHING[letter]:
        assert abs(thumb_gap_m(POSES[letter], finger)) < CONTACT_M, finger


@pytest.mark.parametrize(
    ("letter", "finger", "number"), [("F", "index", 66), ("U", "ring", 2), ("O", "middle", 177)]
)
def test_digits_that_touch_in_a_letter_touch_in_every_hand(
    letter: str, finger: str, number: int
) -> None:
    pose, own = person_pose(POSES[letter], number), person(number)
    mean_m = thumb_gap_m(POSES[letter], finger)
    assert thumb_gap_m(pose, finger, own) == pytest.approx(mean_m, abs=1e-3)
    one_body(pose, 6e-3, own)
