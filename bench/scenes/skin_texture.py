"""The marks that photographs show on a hand: flexion creases, the lines of the palm, nails."""

import itertools
from dataclasses import dataclass

import numpy as np

from handbench.bench.scenes.bones import FINGERS, HAND_AXES, Bone, hand_from_palm, radii_m, skeleton
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.people import MEAN, Person
from handbench.bench.scenes.textures import skin, solid_noise

CREASE_WIDTH_M, CREASE_DEPTH = 0.3e-3, 0.28
WOBBLE_M, WOBBLE_WAVELENGTH_M = 0.6e-3, 5e-3
ROOT_CREASE = 0.5  # where a finger leaves the palm, in lengths of its first phalanx
# Heart, head and life line as (radial, distal) points, millimetres, on the part of the palm between these heights.
PALM_LINES_MM = (
    ((-41, 21), (-28, 24), (-14, 27), (0, 32), (9, 37), (14, 44)),
    ((34, 22), (22, 21), (8, 17), (-6, 11), (-18, 3), (-27, -5)),
    ((34, 22), (25, 19), (15, 10), (8, -4), (5, -18), (6, -34)),
)
PALM_HEIGHT_MM = (5.0, 19.0)
NAIL_TINT = np.array([1.10, 1.16, 1.20], dtype=np.float32)


@dataclass(frozen=True)
class Crease:
    """A fold of skin: the plane through `centre_m` across `axis`, on the `palmar` side, within `reach_m`."""

    centre_m: np.ndarray
    axis: np.ndarray
    palmar: np.ndarray
    reach_m: float


class Skin:
    """Reflectance of a posed hand's skin."""

    def __init__(self, pose: Pose, contrast: float, seed: int, person: Person = MEAN) -> None:
        self.contrast, self.seed, self.palm = contrast, seed, person.palm
        self.hand_from_palm = hand_from_palm(pose)
        bones = skeleton(pose, person)
        self.creases = [crease for name, digit in bones.items() for crease in _creases(name, digit, person)]
        self.nails = [(digit[-1], radii_m(name, person)[-1]) for name, digit in bones.items()]

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """Reflectance [n, 3] at points [n, 3] in the hand frame."""
        reflectance = skin(points_m, self.contrast, self.seed)
        wobble_m = WOBBLE_M * solid_noise(points_m, WOBBLE_WAVELENGTH_M, self.seed + 70)
        lines = _palm_lines(points_m @ self.hand_from_palm @ HAND_AXES / self.palm, wobble_m)
        fold = np.maximum(lines, _folds(self.creases, points_m, wobble_m))
        reflectance *= (1 - CREASE_DEPTH * self.contrast * fold)[:, None].astype(np.float32)
        for bone, radius_m in self.nails:
            near = np.nonzero(np.linalg.norm(points_m - bone.end_m, axis=1) < bone.length_m)[0]
            reflectance[near] *= _nail(bone, radius_m, points_m[near])
        return reflectance


def _creases(name: str, digit: tuple[Bone, ...], person: Person) -> list[Crease]:
    flesh_m = radii_m(name, person)
    creases = []
    if name in FINGERS:
        root = digit[1]
        creases.append(Crease(root.at(ROOT_CREASE * root.length_m), root.axis, root.palmar, 1.7 * flesh_m[0]))
    for inner, outer, radius_m in zip(digit[1:], digit[2:], flesh_m[1:], strict=False):
        axis, palmar = inner.axis + outer.axis, inner.palmar + outer.palmar
        axis, palmar = axis / np.linalg.norm(axis), palmar / np.linalg.norm(palmar)
        shifts_m = (0.0,) if outer is digit[-1] else (-1.3e-3, 1.3e-3)
        creases += [Crease(outer.start_m + s * axis, axis, palmar, 1.7 * radius_m) for s in shifts_m]
    return creases


def _folds(creases: list[Crease], points_m: np.ndarray, wobble_m: np.ndarray) -> np.ndarray:
    """Depth of the flexion creases at each point [n], 0 to 1."""
    fold = np.zeros(len(points_m))
    for crease in creases:
        relative = points_m - crease.centre_m
        near = np.nonzero(np.einsum("ij,ij->i", relative, relative) < crease.reach_m**2)[0]
        across_m = relative[near] @ crease.axis + wobble_m[near]
        side = np.clip((relative[near] @ crease.palmar) / (0.35 * crease.reach_m), 0, 1)
        fold[near] = np.maximum(fold[near], side * np.exp(-((across_m / CREASE_WIDTH_M) ** 2)))
    return fold


def _palm_lines(radial_distal_palmar_m: np.ndarray, wobble_m: np.ndarray) -> np.ndarray:
    """Depth of the palm lines at each point [n] of the mean palm, 0 to 1."""
    radial_distal_palmar = 1e3 * radial_distal_palmar_m
    low, high = PALM_HEIGHT_MM
    on_palm = (radial_distal_palmar[:, 2] > low) & (radial_distal_palmar[:, 2] < high)
    on_palm &= radial_distal_palmar[:, 1] < 48
    flat_mm = radial_distal_palmar[on_palm, :2] + 1.5e3 * wobble_m[on_palm, None]
    distance_mm = np.full(len(flat_mm), np.inf)
    for line in PALM_LINES_MM:
        for start, end in itertools.pairwise(line):
            distance_mm = np.minimum(distance_mm, _to_segment(flat_mm, np.array(start), np.array(end)))
    fold = np.zeros(len(radial_distal_palmar))
    fold[on_palm] = np.exp(-((1e-3 * distance_mm / (1.3 * CREASE_WIDTH_M)) ** 2))
    return fold


def _to_segment(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distance [n] of plane points [n, 2] to a segment."""
    along = end - start
    t = np.clip((points - start) @ along / (along @ along), 0, 1)
    return np.linalg.norm(points - start - t[:, None] * along, axis=1)


def _nail(bone: Bone, radius_m: float, points_m: np.ndarray) -> np.ndarray:
    """Factor [n, 3] on the skin's reflectance: a paler plate with a dark border."""
    relative = points_m - bone.at(0.80 * bone.length_m)
    along, across = relative @ bone.axis / (0.95 * radius_m), relative @ np.cross(bone.axis, bone.palmar)
    outline = (along**4 + (across / (0.72 * radius_m)) ** 4) ** 0.25
    dorsal = relative @ bone.palmar < 0
    plate = np.where(dorsal, np.clip((1 - outline) / 0.08, 0, 1), 0.0)[:, None]
    border = np.where(dorsal, np.exp(-(((outline - 1.02) / 0.05) ** 2)), 0.0)[:, None]
    return ((1 - plate + plate * NAIL_TINT) * (1 - 0.25 * border)).astype(np.float32)
