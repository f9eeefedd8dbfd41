"""Where a hand's skin is palmar: thick and ridged."""

from __future__ import annotations

import numpy as np

from bench.scenes.bones import skeleton
from bench.scenes.poses import Pose

WRIST_M = -0.010  # along a metacarpal: what lies behind its start is the wrist, with thin skin


def palmar(pose: Pose, points_m: np.ndarray) -> np.ndarray:
    """Whether each point [n, 3] of the skin (hand frame) lies on the palm's side of the bone that is nearest: bool [n].
    The palm's side of all metacarpals is the middle one's: the ball of the thumb belongs to the palm."""
    nearest_m = np.full(len(points_m), np.inf)
    on_palm = np.zeros(len(points_m), bool)
    bones = skeleton(pose)
    for digit in bones.values():
        for number, bone in enumerate(digit):
            relative = points_m - bone.start_m
            along_m = relative @ bone.axis
            distance_m = np.linalg.norm(relative - np.clip(along_m, 0, bone.length_m)[:, None] * bone.axis, axis=1)
            nearer = distance_m < nearest_m
            side = bones["middle"][0].palmar if number == 0 else bone.palmar
            skin = relative[nearer] @ side > 0
            nearest_m[nearer] = distance_m[nearer]
            on_palm[nearer] = skin & (along_m[nearer] > WRIST_M) if number == 0 else skin
    return on_palm
