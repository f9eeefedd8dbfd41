"""Bones of the parametric hand: their positions by forward kinematics, and the radii of the flesh
around them. Also a person's joint angles for a pose, which make the digits touch where those of the
mean hand do, and nowhere else.

The palm frame of a right hand has its origin at the palm's centre, y from the wrist to the
fingertips, and the thumb on the −x side; the palm faces −z. The hand frame has the same origin, and
a pose may turn the whole hand in it; without a turn, both frames are equal. Metres.
"""

import itertools
from dataclasses import dataclass
from functools import cache

import numpy as np

from handbench.bench.scenes.hand_pose import FingerPose, Pose, ThumbPose, WristPose
from handbench.bench.scenes.people import LENGTHS_MM, MEAN, Person, person

HAND_AXES = np.diag([-1.0, 1.0, -1.0])  # palm frame from (radial, distal, palmar)
RADIAL, DISTAL, PALMAR = HAND_AXES  # its rows, which are also its columns

# Knuckle centres on the palm's transverse arch (radial, distal, palmar), millimetres; the direction
# of each metacarpal (towards the thumb) and the roll of each finger's bending plane (fingers
# converge when they bend), degrees.
KNUCKLES_MM = {
    "index": (27.0, 43.0, 0.5),
    "middle": (6.0, 47.0, -2.0),
    "ring": (-13.5, 42.0, -1.0),
    "little": (-31.0, 33.0, 2.5),
}
METACARPAL_DEG = {"index": 11.0, "middle": 3.0, "ring": -6.0, "little": -15.0}
ROLL_DEG = {"index": -4.0, "middle": 0.0, "ring": 3.0, "little": 6.0}
THUMB_BASE_MM = (21.0, -37.0, 7.0)
WRIST_MM = (0.0, -42.0, 1.0)
FINGERS = tuple(KNUCKLES_MM)
DIGITS = (*FINGERS, "thumb")
# Flesh radii of each digit, millimetres: at the base of the proximal phalanx, its joints, and the
# tip.
RADII_MM = {
    "index": (9.6, 9.0, 7.9, 6.3),
    "middle": (9.8, 9.2, 8.1, 6.5),
    "ring": (9.2, 8.6, 7.6, 6.1),
    "little": (8.4, 7.6, 6.7, 5.4),
    "thumb": (11.0, 10.0, 7.8),
}
WRIST_SKIN_M = -0.010  # along a metacarpal: behind its start is the wrist, with thin skin
# far above rounding: outside a bent joint, the joint is the nearest point of both of its bones
AS_NEAR_M = 1e-9


@dataclass(frozen=True)
class Bone:
    """A bone of the hand.

    start_m [3]: its proximal joint. axis [3]: unit vector along the bone, towards the fingertip.
    palmar [3]: unit vector across the bone, to the side towards which the digit bends.
    """

    start_m: np.ndarray
    axis: np.ndarray
    palmar: np.ndarray
    length_m: float

    @property
    def end_m(self) -> np.ndarray:
        """The distal joint [3], or the tip of the last bone, metres."""
        return self.start_m + self.length_m * self.axis

    def at(self, share: float, palmar_m: float = 0.0) -> np.ndarray:
        """Return the point [3] a share of the length from the proximal joint along the axis, and
        palmar_m towards the palm's side."""
        return self.start_m + share * self.length_m * self.axis + palmar_m * self.palmar

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the distances [n] of points [n, 3] from the bone's line, metres."""
        relative_m = points_m - self.start_m
        along_m = np.clip(relative_m @ self.axis, 0, self.length_m)
        return np.linalg.norm(relative_m - along_m[:, None] * self.axis, axis=1)

    def child(self, flexion_deg: float, length_m: float) -> "Bone":
        """Return the next bone towards the fingertip. It starts at the end of this bone and is bent
        by flexion_deg towards the palm."""
        c, s = _cos_sin(flexion_deg)
        return Bone(
            self.end_m, c * self.axis + s * self.palmar, c * self.palmar - s * self.axis, length_m
        )

    def turned(self, rotation: np.ndarray) -> "Bone":
        """Return the bone after a rotation [3, 3] about the origin."""
        return Bone(
            rotation @ self.start_m, rotation @ self.axis, rotation @ self.palmar, self.length_m
        )


def radii_m(name: str, person: Person) -> np.ndarray:
    """Return the radii of a digit's flesh, metres: at the base of its first phalanx, at each joint
    towards the tip, and at the tip.

    name: "thumb", "index", "middle", "ring" or "little". person: whose hand it is.
    """
    return np.array(RADII_MM[name]) * person.girth[name] * 1e-3


def skeleton(pose: Pose, person: Person = MEAN) -> dict[str, tuple[Bone, ...]]:
    """Return the bones of each digit in the hand frame, by the digit's name ("thumb", "index", …).
    Each tuple has the metacarpal first, then the phalanges towards the tip."""
    turn = hand_from_palm(pose)
    return {
        name: tuple(bone.turned(turn) for bone in digit)
        for name, digit in skeleton_of_palm(pose, person).items()
    }


def skeleton_of_palm(pose: Pose, person: Person = MEAN) -> dict[str, tuple[Bone, ...]]:
    """Return the bones of each digit in the palm frame, without the pose's turn of the whole hand,
    by the digit's name ("thumb", "index", …). Each tuple has the metacarpal first, then the
    phalanges towards the tip."""
    fingers = {name: _finger(name, getattr(pose, name), person) for name in FINGERS}
    return {"thumb": _thumb(pose.thumb, person)} | fingers


def hand_from_palm(pose: Pose) -> np.ndarray:
    """Return the rotation [3, 3] from the palm frame to the hand frame: the pose's turn of the
    whole hand."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("xyz", pose.turn_deg, degrees=True).as_matrix()


def forearm_from_palm(wrist: WristPose) -> np.ndarray:
    """Return the rotation [3, 3] of the forearm about the wrist, in the coordinates (radial,
    distal, palmar).

    A bent wrist moves the forearm and not the hand: a flexed one brings the forearm to the palm's
    side.
    """
    c, s = _cos_sin(wrist.deviation_deg)
    deviated = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = _cos_sin(wrist.flexion_deg)
    flexed = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    return flexed @ deviated


def forearm_direction(pose: Pose) -> np.ndarray:
    """Return the unit vector [3] from the wrist along the forearm, in the hand frame."""
    return -hand_from_palm(pose) @ HAND_AXES @ forearm_from_palm(pose.wrist)[:, 1]


def palmar(pose: Pose, points_m: np.ndarray, person: Person) -> np.ndarray:
    """Return the mask [n] of the points [n, 3] of the skin (hand frame) that are on the palm's side
    of the hand, without the wrist.

    A point is on the palm's side if it is there relative to the nearest bone (of two equally near
    bones, the inner one). For all metacarpals, the middle finger's palm side counts, so that the
    ball of the thumb belongs to the palm.
    """
    nearest_m = np.full(len(points_m), np.inf)
    on_palm = np.zeros(len(points_m), bool)
    bones = skeleton(pose, person)
    for digit in bones.values():
        for number, bone in enumerate(digit):
            distance_m = bone.distance_m(points_m)
            nearer = distance_m < nearest_m - AS_NEAR_M
            nearest_m[nearer] = distance_m[nearer]
            relative = points_m[nearer] - bone.start_m
            if number == 0:
                beyond_wrist = relative @ bone.axis > WRIST_SKIN_M
                on_palm[nearer] = beyond_wrist & (relative @ bones["middle"][0].palmar > 0)
            else:
                on_palm[nearer] = relative @ bone.palmar > 0
    return on_palm


def _finger(name: str, pose: FingerPose, person: Person) -> tuple[Bone, ...]:
    metacarpal_m, proximal_m, middle_m, distal_m = _lengths_m(name, person)
    knuckle_m = _on_palm_m(KNUCKLES_MM[name], person)
    c, s = _cos_sin(ROLL_DEG[name])
    palmar = c * PALMAR + s * RADIAL
    along = _towards_thumb(METACARPAL_DEG[name])
    metacarpal = Bone(
        knuckle_m - metacarpal_m * along, along, _orthogonal(palmar, along), metacarpal_m
    )
    spread = _towards_thumb(pose.spread_deg)
    knuckle = Bone(knuckle_m, spread, _orthogonal(palmar, spread), 0.0)
    proximal = knuckle.child(pose.mcp_deg, proximal_m)
    middle = proximal.child(pose.pip_deg, middle_m)
    return metacarpal, proximal, middle, middle.child(pose.dip_deg, distal_m)


def _thumb(pose: ThumbPose, person: Person) -> tuple[Bone, ...]:
    metacarpal_m, proximal_m, distal_m = _lengths_m("thumb", person)
    c, s = _cos_sin(pose.palmar_deg)
    axis = c * _towards_thumb(pose.radial_deg) + s * PALMAR
    across = _orthogonal(-RADIAL, axis)
    c, s = _cos_sin(pose.opposition_deg)
    palmar = c * across + s * np.cross(across, axis)
    metacarpal = Bone(_on_palm_m(THUMB_BASE_MM, person), axis, palmar, metacarpal_m)
    proximal = metacarpal.child(pose.mcp_deg, proximal_m)
    return metacarpal, proximal, proximal.child(pose.ip_deg, distal_m)


def _lengths_m(name: str, person: Person) -> np.ndarray:
    return 1e-3 * (np.array(LENGTHS_MM[name]) * person.bones[name])


def _on_palm_m(point_mm: tuple[float, float, float], person: Person) -> np.ndarray:
    """Return a point [3] of a person's palm in the palm frame. point_mm: its (radial, distal,
    palmar) coordinates on the mean hand."""
    return 1e-3 * HAND_AXES @ (np.array(point_mm) * person.palm)


def _towards_thumb(angle_deg: float) -> np.ndarray:
    c, s = _cos_sin(angle_deg)
    return c * DISTAL + s * RADIAL


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    return np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))


def _orthogonal(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    rest = vector - (vector @ axis) * axis
    return rest / np.linalg.norm(rest)


# parts that are nearer than this touch, and keep their distance; others stay as far apart at least
TOUCHING_M = 2e-3
# deviations from contact and from the letter's angles with the same weight
CONTACT_M, ANGLE_DEG = (2e-4, 5.0)
BALLS = 6  # of each bone


@cache
def person_pose(pose: Pose, number: int) -> Pose:
    """Return the pose with joint angles fitted to the hand of the person `number`, so that the
    person's digits touch where those of the mean hand do, and nowhere else. Number 0 is the mean
    hand, whose pose is returned unchanged."""
    if number == 0:
        return pose
    from scipy.optimize import least_squares

    mean_m = _gaps_m(pose, MEAN)
    touch = mean_m < TOUCHING_M
    digits = [getattr(pose, name) for name in DIGITS]
    given = np.array([angle for digit in digits for _, angle in digit])
    ranges = [field.metadata for digit in digits for field in type(digit).model_fields.values()]
    limits = np.array([(least.ge, most.le) for least, most in ranges]).T

    def misfit(angles_deg: np.ndarray) -> np.ndarray:
        gaps_m = _gaps_m(_posed(pose, angles_deg), person(number))
        off_m = np.where(touch, gaps_m - mean_m, np.minimum(gaps_m - TOUCHING_M, 0))
        return np.r_[off_m / CONTACT_M, (angles_deg - given) / ANGLE_DEG]

    inside = np.clip(given, limits[0] + 1e-6, limits[1] - 1e-6)
    fit = least_squares(
        misfit, inside, bounds=limits, diff_step=1e-4, x_scale=ANGLE_DEG, max_nfev=40
    )
    return _posed(pose, np.round(fit.x, 3))


def _posed(pose: Pose, angles_deg: np.ndarray) -> Pose:
    """Return the pose with its joint angles replaced by angles_deg [n], which lists the angles of
    all digits in the order of DIGITS."""
    values, digits = iter(angles_deg.tolist()), {}
    for name in DIGITS:
        digit = getattr(pose, name)
        angles = dict(zip(type(digit).model_fields, values, strict=False))
        digits[name] = digit.model_copy(update=angles)
    return pose.model_copy(update=digits)


def _gaps_m(pose: Pose, of: Person) -> np.ndarray:
    """Return the distances [n] in metres between the flesh of pairs of parts of a person's hand,
    negative if they overlap.

    The pairs are: the thumb and each finger, thumb and palm, neighbouring fingers (beyond the skin
    that joins them), and each finger and the palm.
    """
    bones, radii = skeleton_of_palm(pose, of), {name: radii_m(name, of) for name in DIGITS}
    flesh = {name: _balls(bones[name][1:], radii[name]) for name in DIGITS}
    palm = np.concatenate([_balls(bones[name][:1], radii[name][[0, 0]]) for name in FINGERS])
    thumb = flesh.pop("thumb")
    outer = [finger[BALLS:] for finger in flesh.values()]
    pairs = [(thumb, other) for other in (*flesh.values(), palm)]
    pairs += [*itertools.pairwise(outer), *((finger, palm) for finger in outer)]
    return np.array([_gap_m(*pair) for pair in pairs])


def _balls(bones: tuple[Bone, ...], radii_m: np.ndarray) -> np.ndarray:
    """Return balls that fill the flesh around successive bones, as rows (x, y, z, radius) [n, 4],
    metres. radii_m: of the flesh at the start of the first bone, and at each bone's end."""
    along = np.linspace(0, 1, BALLS)[:, None]
    parts = [
        (bone.start_m + along * bone.length_m * bone.axis, start_m + along * (end_m - start_m))
        for bone, start_m, end_m in zip(bones, radii_m, radii_m[1:], strict=False)
    ]
    return np.concatenate([np.hstack(part) for part in parts])


def _gap_m(a: np.ndarray, b: np.ndarray) -> float:
    apart_m = np.linalg.norm(a[:, None, :3] - b[:, :3], axis=2)
    return float((apart_m - a[:, 3:] - b[:, 3]).min())
