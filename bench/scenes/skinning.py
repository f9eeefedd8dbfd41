"""The skin of a hand that moves its fingers: linear-blend skinning (Magnenat-Thalmann, Laperrière &
Thalmann 1988). Each vertex moves with the bones around it, with weights that fall with its distance
from them."""

from collections.abc import Iterator

import numpy as np

from handbench.bench.scenes.bones import (
    HAND_AXES,
    WRIST_MM,
    Bone,
    forearm_from_palm,
    hand_from_palm,
    skeleton,
)
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.people import Person

FALL = 8  # power of the distance with which a bone's weight falls
FOREARM_M = 0.1


class SkinnedHand:
    """Vertices [n, 3] of a hand's skin in the hand frame, in the pose `start`, that can be moved to
    other poses. person: whose hand it is."""

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
