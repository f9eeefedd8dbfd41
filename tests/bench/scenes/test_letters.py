"""The letters of the manual alphabet: the right fingers raised, contacts where asked for, no digit
inside another."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from handbench.bench.scenes.bones import (
    DISTAL,
    FINGERS,
    PALMAR,
    RADIAL,
    RADII_MM,
    Bone,
    skeleton,
    skeleton_of_palm,
)
from handbench.bench.scenes.hand import TIP_TISSUE_MM
from handbench.bench.scenes.hand_pose import POSES, FingerPose, Pose
from tests.bench.scenes.hand_field import hand_field

DIGITS = (*FINGERS, "thumb")
CONTACT_M = 1.5e-3  # flesh gives way by this much where digits touch
RAISED = {
    "A": (), "B": FINGERS, "C": (), "D": ("index",), "E": (), "F": ("middle", "ring", "little"), "G": ("index",),
    "H": ("index", "middle"), "I": ("little",), "K": ("index", "middle"), "L": ("index",), "M": (), "N": (), "O": (),
    "P": ("index", "middle"), "Q": ("index",), "R": ("index", "middle"), "S": (), "T": (), "U": ("index", "middle"),
    "V": ("index", "middle"), "W": ("index", "middle", "ring"), "X": (), "Y": ("little",),
}  # fmt: skip
HALF_RAISED = {"K": ("middle",), "P": ("middle",), "R": ("index", "middle")}  # by up to 45°
TOUCHING = {
    "A": ("index",), "D": ("middle", "ring"), "E": ("index", "middle", "ring"), "F": ("index",), "K": ("middle",),
    "M": ("middle", "ring"), "N": ("index", "middle"), "O": ("index", "middle"), "P": ("middle",),
    "S": ("index", "middle"), "T": ("index", "middle"), "U": ("ring",), "W": ("little",), "X": ("middle",),
}  # fmt: skip
APART_M = {"C": 0.030, "G": 0.005, "L": 0.020, "Q": 0.005, "Y": 0.020}  # thumb from index, at least


def flesh(name: str, digit: tuple[Bone, ...]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centres [n, 3] and radii [n] of balls along each phalanx, metres: an independent, plainer
    hand."""
    radii_m, balls = 1e-3 * np.array(RADII_MM[name]), []
    t = np.linspace(0, 1, 20)
    for number, bone in enumerate(digit[1:]):
        length_m = bone.length_m + (1e-3 * TIP_TISSUE_MM - radii_m[-1] if bone is digit[-1] else 0)
        radius_m = radii_m[number] + (radii_m[number + 1] - radii_m[number]) * t
        balls.append((bone.start_m + length_m * t[:, None] * bone.axis, radius_m))
    return balls


def clearance_m(pose: Pose, one: str, other: str) -> tuple[float, np.ndarray]:
    """Smallest distance between two digits' flesh, negative where they overlap, and the place. Webs
    do not count."""
    bones = skeleton(pose)
    neighbours = (
        one in FINGERS and other in FINGERS and abs(FINGERS.index(one) - FINGERS.index(other)) == 1
    )
    smallest, place = np.inf, np.zeros(3)
    for i, (a, ra) in enumerate(flesh(one, bones[one])):
        for j, (b, rb) in enumerate(flesh(other, bones[other])):
            gap = np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb
            if neighbours and i == j == 0:
                gap[:8], gap[:, :8] = np.inf, np.inf
            k, m = np.unravel_index(gap.argmin(), gap.shape)
            if gap[k, m] < smallest:
                smallest, place = gap[k, m], (a[k] * rb[m] + b[m] * ra[k]) / (ra[k] + rb[m])
    return smallest, place


def overlap_m(pose: Pose) -> float:
    """Greatest depth to which two digits, a fingertip and its base, or a tip and the metacarpals
    overlap."""
    bones = skeleton(pose)
    gaps = [clearance_m(pose, one, other)[0] for one, other in itertools.combinations(DIGITS, 2)]
    t = np.linspace(0, 0.9, 20)
    metacarpals = np.concatenate(
        [np.array([bones[f][0].at(x * bones[f][0].length_m) for x in t]) for f in FINGERS]
    )
    palm = metacarpals, np.full(len(metacarpals), 9e-3)
    for name in DIGITS:
        balls = flesh(name, bones[name])
        for (a, ra), (b, rb) in (
            (balls[-1], palm),
            *([(balls[0], balls[2])] if name in FINGERS else []),
        ):
            gaps.append((np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb).min())
    return -min(gaps)


@pytest.mark.parametrize("name", POSES)
def test_no_digit_passes_through_another(name: str) -> None:
    assert overlap_m(POSES[name]) < CONTACT_M


def test_a_thumb_through_a_fist_is_noticed() -> None:
    fist = {name: getattr(POSES["S"], name) for name in FINGERS}
    assert overlap_m(Pose(thumb=POSES["B"].thumb, **fist)) > 2 * CONTACT_M
    assert overlap_m(Pose(index=FingerPose(mcp_deg=95, pip_deg=120, dip_deg=90))) > 1.5 * CONTACT_M
    assert overlap_m(Pose(index=FingerPose(spread_deg=-20))) > 2 * CONTACT_M


def test_the_alphabet_is_whole() -> None:
    assert "".join(POSES) == "ABCDEFGHIKLMNOPQRSTUVWXY"


@pytest.mark.parametrize("letter", RAISED)
def test_letters_raise_the_right_fingers(letter: str) -> None:
    bones = skeleton_of_palm(POSES[letter])
    for name in FINGERS:
        cosine = min(bones[name][-1].axis @ bones[name][1].axis, bones[name][1].axis @ DISTAL)
        if name in RAISED[letter]:
            assert cosine > (0.7 if name in HALF_RAISED.get(letter, ()) else 0.9), name
        else:
            assert cosine < 0.6, name


@pytest.mark.parametrize("letter", TOUCHING)
def test_the_thumb_touches_what_the_letter_asks_for(letter: str) -> None:
    for finger in TOUCHING[letter]:
        gap_m, place_m = clearance_m(POSES[letter], "thumb", finger)
        assert abs(gap_m) < CONTACT_M, finger
        assert hand_field(POSES[letter])(place_m[None])[0] < 5e-4, (
            finger
        )  # the skin closes there, or nearly


@pytest.mark.parametrize("letter", APART_M)
def test_the_thumb_stays_away_where_the_letter_asks_for_it(letter: str) -> None:
    ends = [skeleton(POSES[letter])[name][-1].end_m for name in ("thumb", "index")]
    assert clearance_m(POSES[letter], "thumb", "index")[0] > APART_M[letter]
    assert np.linalg.norm(ends[0] - ends[1]) > APART_M[letter] + 0.012


def test_neighbours_lie_together_in_u_and_apart_in_v() -> None:
    tips = {k: [skeleton(POSES[k])[n][-1].end_m for n in ("index", "middle")] for k in "UHVRK"}
    apart_m = {letter: np.linalg.norm(a - b) for letter, (a, b) in tips.items()}
    assert apart_m["U"] < 0.025 and apart_m["H"] < 0.025
    assert apart_m["V"] > 0.040 and apart_m["K"] > 0.040


def test_r_crosses_the_middle_finger_behind_the_index() -> None:
    index, middle = (skeleton(POSES["R"])[name][-1].end_m for name in ("index", "middle"))
    assert (middle - index) @ RADIAL > 0.005
    assert (middle - index) @ PALMAR < -0.005
    assert abs(clearance_m(POSES["R"], "index", "middle")[0]) < CONTACT_M


@pytest.mark.parametrize(
    ("letter", "fingers"),
    [("M", ("index", "middle", "ring")), ("N", ("index", "middle")), ("T", ("index",))],
)
def test_the_thumb_is_under_as_many_fingers_as_the_letter_asks_for(
    letter: str, fingers: tuple[str, ...]
) -> None:
    bones = skeleton(POSES[letter])
    thumb = np.concatenate(
        [bone.at(t * bone.length_m)[None] for bone in bones["thumb"][1:] for t in (0, 0.5, 1)]
    )
    for name in FINGERS:
        tip = bones[name][-1].end_m
        over = (tip - thumb[np.linalg.norm((thumb - tip)[:, :2], axis=1).argmin()]) @ PALMAR
        assert (over > 0.008) == (name in fingers), (name, over)


def test_pointing_letters_point_as_the_viewer_sees_them() -> None:
    right, down = RADIAL, -DISTAL  # the thumb's side of an upright palm is the viewer's right
    for letter in "GH":
        assert skeleton(POSES[letter])["index"][-1].axis @ right > 0.9
    for letter in "PQ":
        assert skeleton(POSES[letter])["index"][-1].axis @ down > 0.7
        assert (
            skeleton(POSES[letter])["middle"][0].palmar @ PALMAR < -0.7
        )  # the viewer sees the back of the hand
    for letter in "CO":
        assert (
            skeleton(POSES[letter])["middle"][0].palmar @ right > 0.6
        )  # open to the right, as the printed letters


def test_letters_differ() -> None:
    joints_m = [
        np.array([b.end_m for digit in skeleton(pose).values() for b in digit])
        for pose in POSES.values()
    ]
    for one, other in itertools.combinations(joints_m, 2):
        assert np.abs(one - other).max() > 5e-3
