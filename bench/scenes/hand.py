"""The skin of the parametric hand: the zero set of a signed distance that joins round cones over
the posed bones smoothly; and that skin while the fingers move."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from handbench.bench.scenes.bones import (
    DIGITS,
    DISTAL,
    FINGERS,
    HAND_AXES,
    WRIST_MM,
    Bone,
    forearm_from_palm,
    hand_from_palm,
    radii_m,
    skeleton,
    skeleton_of_palm,
)
from handbench.bench.scenes.hand_pose import Pose, WristPose
from handbench.bench.scenes.implicit import (
    Field,
    round_cone,
    smooth_minimum,
    smooth_union,
    zero_set,
)
from handbench.bench.scenes.people import MEAN, Person
from handbench.groundtruth.mesh.surface import mesh
from handbench.support.rays import TriangleMesh

TIP_TISSUE_MM = 3.8  # soft tissue beyond the last bone
FOREARM_END_MM = -88.0
MARGIN_M = 0.032  # of the box around all joints
WITHIN_FINGER_MM, WITHIN_PALM_MM = 3.5, 13.0
FALL = 8  # power of the distance with which a bone's weight falls as it moves the skin
FOREARM_M = 0.1
# blend of fingers that merely touch (a narrow groove), and of fingers at their webs
CONTACT_MM, WEB_MM = (2.5, 11.0)
# the web fades, from the knuckle
WEB_REACH_MM = {name: (14.0, 34.0) for name in FINGERS} | {"thumb": (6.0, 22.0)}


def hand_mesh(pose: Pose, edge_m: float, person: Person = MEAN) -> TriangleMesh:
    """Make the mesh of a right hand's skin in the hand frame, metres: closed, in one piece, with
    outward normals and edges of about edge_m.

    The origin is the palm's centre. Unless the pose turns the hand, +y points towards the
    fingertips and the palm faces −z. person: whose hand it is.
    """
    vertices_m, faces = zero_set(palm_field(pose, person), *_bounds_m(pose, person), edge_m)
    surface = mesh(vertices_m @ hand_from_palm(pose).T, faces)
    surface.compute_vertex_normals()
    return surface


def _bounds_m(pose: Pose, person: Person) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner [3] of a box around the hand and forearm in the palm frame,
    metres."""
    digits = skeleton_of_palm(pose, person).values()
    joints_m = np.array([p for digit in digits for b in digit for p in (b.start_m, b.end_m)])
    corners_mm = itertools.product(
        (-40.0, 40.0), (FOREARM_END_MM - 4, FOREARM_END_MM + 58), (-30.0, 30.0)
    )
    arm_m = (
        1e-3 * np.array([_bent(pose.wrist, corner, person) for corner in corners_mm]) @ HAND_AXES.T
    )
    margin_m = MARGIN_M * max(1.0, *person.palm)
    lower_m, upper_m = joints_m.min(axis=0) - margin_m, joints_m.max(axis=0) + margin_m
    return np.minimum(lower_m, arm_m.min(axis=0)), np.maximum(upper_m, arm_m.max(axis=0))


def palm_field(pose: Pose, person: Person) -> Field:
    """Return the signed distance to the skin of a posed hand, as a function from points [n, 3] in
    the palm frame to metres [n], negative inside. The sign is exact, the distance approximate."""
    bones = skeleton_of_palm(pose, person)
    palm = _palm(bones, pose.wrist, person)
    digits = {name: _digit(bones[name][1:], radii_m(name, person)) for name in DIGITS}
    # from the forearm to the wrist
    arm = HAND_AXES @ forearm_from_palm(pose.wrist) @ HAND_AXES.T @ DISTAL
    end_m = arm @ (1e-3 * HAND_AXES @ _bent(pose.wrist, (0.0, FOREARM_END_MM, 0.0), person))

    def distance(points: np.ndarray) -> np.ndarray:
        result = palm(points)
        for name, digit in digits.items():
            blend_m = _web_blend_m(
                points, bones[name][1].start_m, *WEB_REACH_MM[name], person.palm[0]
            )
            result = smooth_minimum(result, digit(points), blend_m)
        return -smooth_minimum(-result, points @ arm - end_m, 3e-3)

    return distance


def _bent(wrist: WristPose, point_mm: ArrayLike, person: Person) -> np.ndarray:
    """Return where a point of the mean hand's straight forearm is after scaling to this person and
    bending the wrist. point_mm and the result [3] are (radial, distal, palmar) coordinates in
    millimetres."""
    wrist_mm = WRIST_MM * np.array(person.palm)
    return forearm_from_palm(wrist) @ (np.asarray(point_mm) * person.palm - wrist_mm) + wrist_mm


def _web_blend_m(
    points: np.ndarray, knuckle_m: np.ndarray, near_mm: float, far_mm: float, scale: float
) -> np.ndarray:
    """Return the width in metres [n] of the smooth transition between a digit and its neighbours at
    points [n, 3].

    It is wide (the web of skin between digits) up to near_mm from the knuckle at knuckle_m [3], and
    narrow (mere contact) beyond far_mm. scale: the person's factor on widths.
    """
    distance_mm = 1e3 * np.linalg.norm(points - knuckle_m, axis=1) / scale
    t = np.clip((distance_mm - near_mm) / (far_mm - near_mm), 0, 1)
    fade = 1 - t**3 * (t * (6 * t - 15) + 10)
    return 1e-3 * (CONTACT_MM + (WEB_MM * scale - CONTACT_MM) * fade)


def _digit(phalanges: tuple[Bone, ...], radii_m: np.ndarray) -> Field:
    """Return the signed distance to a digit, as a function of points.

    Neighbouring phalanges are joined smoothly; others, such as a curled tip and its base, merely
    touch. radii_m: of the flesh at the base, at each joint, and at the tip.
    """
    parts = [
        _phalanx(b, r, s) for b, r, s in zip(phalanges[:-1], radii_m, radii_m[1:], strict=False)
    ]
    parts.append(_fingertip(phalanges[-1], *radii_m[-2:]))

    def distance(points: np.ndarray) -> np.ndarray:
        values = [part(points) for part in parts]
        pairs = [
            smooth_minimum(a, b, 1e-3 * WITHIN_FINGER_MM) for a, b in itertools.pairwise(values)
        ]
        return reduce(lambda a, b: smooth_minimum(a, b, 1e-3 * CONTACT_MM), pairs)

    return distance


def _phalanx(bone: Bone, base_m: float, end_m: float) -> Field:
    """Return the signed distance to one phalanx, as a function of points. The phalanx is narrower
    between its joints and has a pad on the palm's side. base_m, end_m: radii at the two joints."""
    waist = 0.97 * (base_m + end_m) / 2
    return smooth_union(
        [
            round_cone(bone.at(0), bone.at(0.55), base_m, waist),
            round_cone(bone.at(0.5), bone.at(1), waist, end_m),
            round_cone(bone.at(0.33, 2.2e-3), bone.at(0.72, 2.0e-3), waist, 0.96 * waist),
        ],
        4e-3,
    )


def _fingertip(bone: Bone, joint_m: float, tip_m: float) -> Field:
    """Return the signed distance to the last phalanx, as a function of points. The phalanx is flat
    on the nail's side and full on the other. joint_m, tip_m: radii at its joint and at its tip."""
    flesh = replace(bone, length_m=bone.length_m + 1e-3 * TIP_TISSUE_MM - tip_m)
    return smooth_union(
        [
            round_cone(flesh.at(0), flesh.at(1, 0.3e-3), joint_m, tip_m),
            round_cone(
                flesh.at(0.45, 1.9e-3), flesh.at(0.85, 1.2e-3), 0.97 * joint_m, 1.03 * tip_m
            ),
        ],
        4e-3,
    )


def _palm(bones: dict[str, tuple[Bone, ...]], wrist: WristPose, person: Person) -> Field:
    """Return the signed distance to palm and forearm, as a function of points: metacarpals, the
    pads at the roots of the fingers, the balls of thumb and little finger, wrist and forearm."""
    knuckles = [1e3 * bones[name][1].start_m @ HAND_AXES for name in FINGERS]
    thick = person.palm[2]

    def cone(
        start_mm: np.ndarray, end_mm: np.ndarray, start_radius_mm: float, end_radius_mm: float
    ) -> Field:
        """Return a round cone between two points in (radial, distal, palmar) coordinates,
        millimetres; the radii are multiplied by the person's thickness."""
        start_m, end_m = (1e-3 * HAND_AXES @ point_mm for point_mm in (start_mm, end_mm))
        return round_cone(
            start_m, end_m, 1e-3 * (thick * start_radius_mm), 1e-3 * (thick * end_radius_mm)
        )

    def own(*point_mm: float) -> np.ndarray:
        return np.array(person.palm) * point_mm

    parts = [_metacarpal(bones[name][0], radii_m(name, person)[0], thick) for name in FINGERS]
    parts += [
        cone(a + own(0, -6, 1.5), b + own(0, -6, 1.5), 9.0, 9.0)
        for a, b in itertools.pairwise(knuckles)
    ]
    parts += _thenar(bones["thumb"][0], bones["index"][0], bones["middle"][0], thick)
    parts += [
        cone(own(-21, -42, 4), own(-32, 8, 4), 13.0, 10.0),  # ball of the little finger
        cone(own(-30, -10, 3), knuckles[3] + own(-1, -2, 2), 10.0, 9.5),
        cone(own(-14, -40, 6), own(-20, -14, 5), 12.0, 9.0),
        cone(own(2, -16, 1), _bent(wrist, (0, -94, 0), person), 11.0, 16.5),  # carpus and wrist
        cone(own(18, -38, 2), _bent(wrist, (12, -94, 0), person), 13.0, 17.0),  # radius and ulna
        cone(own(-16, -38, 1), _bent(wrist, (-14, -94, 0), person), 13.5, 16.5),
    ]
    if wrist != WristPose():
        # the straight carpus ends where the wrist bends
        parts.append(cone(own(2, -16, 1), own(*WRIST_MM), 11.0, 13.0))
    return smooth_union(parts, 1e-3 * WITHIN_PALM_MM * thick)


def _metacarpal(bone: Bone, base_m: float, thick: float) -> Field:
    return smooth_union(
        [
            round_cone(bone.at(0, 0.5e-3), bone.at(1), thick * 11e-3, base_m),
            round_cone(bone.at(0.98, 2.5e-3), bone.at(1.12, 2e-3), base_m, base_m - 0.6e-3),
        ],
        6e-3,
    )


def _thenar(thumb: Bone, index: Bone, middle: Bone, thick: float) -> list[Field]:
    """Return the signed distances to the parts of the ball of the thumb: the thumb's metacarpal,
    the muscles, and the skin between thumb and index finger. thick: the person's factor on
    radii."""
    muscle, inner, web = (
        thumb.at(a, thick * m) for a, m in ((0.7, 5e-3), (0.12, 5.5e-3), (0.82, 3e-3))
    )
    from_middle = middle.at(0.15, thick * 6e-3)
    from_index = index.at(0.5, thick * 2e-3)
    return [
        round_cone(thumb.at(0), thumb.at(1), thick * 12e-3, thick * 10e-3),
        round_cone(inner, muscle, thick * 12e-3, thick * 10e-3),
        round_cone(from_middle, muscle, thick * 10e-3, thick * 8e-3),
        round_cone(from_index, web, thick * 9e-3, thick * 7e-3),
    ]


class SkinnedHand:
    """Vertices [n, 3] of a hand's skin in the hand frame, in the pose `start`, that can be moved to
    other poses. person: whose hand it is.

    By linear-blend skinning (Magnenat-Thalmann, Laperrière & Thalmann 1988): each vertex moves with
    the bones around it, with weights that fall with its distance from them."""

    def __init__(self, vertices_m: np.ndarray, start: Pose, person: Person) -> None:
        self.person, self.vertices_m = person, vertices_m
        self._bones = list(_bones(start, person))
        distance_m = np.stack([bone.distance_m(vertices_m) for bone in self._bones])
        near = (distance_m.min(axis=0) / distance_m) ** FALL
        self._weights = near / near.sum(axis=0)

    def posed(self, pose: Pose) -> np.ndarray:
        """Return the vertices [n, 3] in another pose; in the pose of the start, exactly those of
        the start."""
        moved_m = self.vertices_m.copy()
        for weight, before, now in zip(
            self._weights, self._bones, _bones(pose, self.person), strict=True
        ):
            if np.array_equal(_axes(before), _axes(now)) and (before.start_m == now.start_m).all():
                continue
            turn = _axes(now) @ _axes(before).T
            relative_m = self.vertices_m - before.start_m
            shift_m = relative_m @ turn.T + now.start_m - self.vertices_m
            moved_m += weight[:, None] * shift_m
        return moved_m


def _bones(pose: Pose, person: Person) -> Iterator[Bone]:
    """Yield all bones of the hand in the hand frame, and that of the forearm."""
    for digit in skeleton(pose, person).values():
        yield from digit
    turn = hand_from_palm(pose) @ HAND_AXES
    wrist_m = turn @ (1e-3 * np.array(WRIST_MM) * person.palm)
    arm = turn @ forearm_from_palm(pose.wrist)
    yield Bone(wrist_m, -arm[:, 1], arm[:, 2], FOREARM_M)


def _axes(bone: Bone) -> np.ndarray:
    """Return the bone's axes as columns [3, 3]."""
    return np.stack([bone.axis, bone.palmar, np.cross(bone.axis, bone.palmar)], axis=1)
