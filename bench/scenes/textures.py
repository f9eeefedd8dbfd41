"""Solid textures of skin and foam, and marks on a hand: flexion creases, lines of the palm, nails.

A solid texture is a reflectance that depends on a point's position in the body, so that all
photographs show the same pattern.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from handbench.bench.scenes.bones import FINGERS, HAND_AXES, Bone, hand_from_palm, radii_m, skeleton
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.people import MEAN, Person
from handbench.support.compiled import njit
from handbench.support.parallel import for_each

SKIN_RGB = (0.62, 0.36, 0.25)  # linear reflectances
FOAM_RGB = (0.78, 0.78, 0.76)
STYRODUR_RGB = (0.30, 0.42, 0.48)

# (wavelength in metres, relative contrast): blotches, mottling, pores and skin ridges.
SKIN_OCTAVES = ((9e-3, 0.030), (4e-3, 0.030), (1.8e-3, 0.035), (0.9e-3, 0.045), (0.5e-3, 0.045))
CREASES = ((2.6e-3, 0.10), (1.2e-3, 0.07))  # fine dark lines where a smooth noise crosses zero
BEAD_M = 2.2e-3  # foam beads
BLOCK = 50_000  # points per task


def skin(points_m: np.ndarray, contrast: float, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of skin at points [n, 3]: a skin tone with faint random
    patterns of 9 to 0.5 mm and fine dark creases. contrast: strength of the patterns, 1 as in
    nature. seed: of the patterns."""
    shade = np.zeros(len(points_m), dtype=np.float32)
    for octave, (wavelength_m, amplitude) in enumerate(SKIN_OCTAVES):
        shade += 2.2 * amplitude * solid_noise(points_m, wavelength_m, seed + octave)
    for octave, (wavelength_m, depth) in enumerate(CREASES):
        shade -= depth * np.exp(
            -((solid_noise(points_m, wavelength_m, seed + 50 + octave) / 0.10) ** 2)
        )
    redness = solid_noise(points_m, 14e-3, seed + 90)
    tint = 1 + 0.10 * redness[:, None] * np.array([0.3, -1.0, -0.8], dtype=np.float32)
    return (np.array(SKIN_RGB, dtype=np.float32) * np.exp(contrast * shade)[:, None] * tint).astype(
        np.float32
    )


def foam(points_m: np.ndarray, contrast: float, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of styrofoam at points [n, 3]: beads of different brightness
    with darker seams. contrast: strength of the pattern, 1 as in nature. seed: of the pattern."""
    seam, tone = cells(points_m, BEAD_M, seed)
    shade = 0.16 * tone - 0.35 * np.exp(-((seam / (0.12 * BEAD_M)) ** 2))
    shade += 0.06 * solid_noise(points_m, 0.6e-3, seed + 1)
    return np.array(FOAM_RGB, dtype=np.float32) * np.exp(contrast * shade)[:, None].astype(
        np.float32
    )


def styrodur(points_m: np.ndarray, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of extruded foam board at points [n, 3]: a nearly plain
    blue-grey. seed: of its faint grain."""
    grain = 0.08 * solid_noise(points_m, 2e-3, seed) + 0.06 * solid_noise(
        points_m, 0.8e-3, seed + 1
    )
    return np.array(STYRODUR_RGB, dtype=np.float32) * np.exp(grain)[:, None].astype(np.float32)


def solid_noise(points_m: np.ndarray, wavelength_m: float, seed: int) -> np.ndarray:
    """Compute smooth random values [n] (about ±1) at points [n, 3] that vary in space with a
    typical period of wavelength_m. The same seed gives the same values."""
    return _at_points(_gradient_noise, points_m / wavelength_m, seed, 1)[0]


def cells(points_m: np.ndarray, size_m: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Divide space into random (Worley) cells of about size_m.

    Returns, for points [n, 3], the distance [n] in metres to the nearest wall of the cell around
    the point, and the random brightness [n] of that cell, −1 to 1.
    """
    seam, tone = _at_points(_cells, points_m / size_m, seed, 2)
    return size_m * seam, tone


def _at_points(
    kernel: Callable[..., None], points: np.ndarray, seed: int, count: int
) -> np.ndarray:
    """Run a compiled texture function on all cores. points [n, 3]: in units of its lattice. Returns
    float32 [count, n]: `count` values for each point."""
    result = np.empty((count, len(points)), dtype=np.float32)

    def work(first: int) -> None:
        part = slice(first, first + BLOCK)
        kernel(points[part], np.uint32(seed), result[:, part])

    for_each(work, range(0, len(points), BLOCK))
    return result


@njit(inline="always")
def _hash(i: int, j: int, k: int, seed: np.uint32) -> np.uint32:
    """Return a pseudo-random 32-bit number of the lattice point (i, j, k) for a seed."""
    h = (
        np.uint32(i * 73856093)
        ^ np.uint32(j * 19349663)
        ^ np.uint32(k * 83492791)
        ^ np.uint32(seed * 2654435761)
    )
    h = np.uint32(h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = np.uint32(np.uint32(h) ^ (np.uint32(h) >> np.uint32(15))) * np.uint32(0x846CA68B)
    return np.uint32(np.uint32(h) ^ (np.uint32(h) >> np.uint32(16)))


@njit(inline="always")
def _fraction(h: np.uint32, shift: int) -> float:
    """Return eight bits of the hash h, starting at bit `shift`, as a number from −1 to 1."""
    return ((h >> np.uint32(shift)) & np.uint32(255)) / 127.5 - 1.0


@njit(inline="always")
def _fade(offset: float) -> float:
    """Return the quintic interpolation weight at an offset from a lattice point: 1 at the point, 0
    at its neighbours, with smooth derivatives at both."""
    f = 1 - abs(offset)
    return f**3 * (10 - 15 * f + 6 * f * f)


@njit(nogil=True, cache=True)
def _gradient_noise(points: np.ndarray, seed: np.uint32, result: np.ndarray) -> None:
    """Compute Perlin noise (about ±1) at points [n, 3] in units of its lattice, and write it into
    result[0]. Gradients at lattice points are hashes, interpolated with quintic weights."""
    for n in range(len(points)):
        x, y, z = points[n]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        total = 0.0
        for di in range(2):
            for dj in range(2):
                for dk in range(2):
                    h = _hash(i + di, j + dj, k + dk, seed)
                    a, b, c = x - i - di, y - j - dj, z - k - dk
                    slope = _fraction(h, 0) * a + _fraction(h, 8) * b + _fraction(h, 16) * c
                    total += _fade(a) * _fade(b) * _fade(c) * slope
        result[0, n] = 1.6 * total


@njit(nogil=True, cache=True)
def _cells(points: np.ndarray, seed: np.uint32, result: np.ndarray) -> None:
    """Compute Worley cells at points [n, 3] in units of their lattice, with one random cell centre
    in each lattice cube. The distance to the nearest wall is written into result[0], and the cell's
    brightness into result[1]."""
    for n in range(len(points)):
        x, y, z = points[n]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        first, second, tone = 1e9, 1e9, 0.0
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    h = _hash(i + di, j + dj, k + dk, seed)
                    a = i + di + 0.5 + 0.45 * _fraction(h, 0) - x
                    b = j + dj + 0.5 + 0.45 * _fraction(h, 8) - y
                    c = k + dk + 0.5 + 0.45 * _fraction(h, 16) - z
                    distance = np.sqrt(a * a + b * b + c * c)
                    if distance < first:
                        first, second, tone = distance, first, _fraction(h, 24)
                    elif distance < second:
                        second = distance
        result[0, n], result[1, n] = 0.5 * (second - first), tone


CREASE_WIDTH_M, CREASE_DEPTH = 0.3e-3, 0.28
WOBBLE_M, WOBBLE_WAVELENGTH_M = 0.6e-3, 5e-3
ROOT_CREASE = 0.5  # where a finger leaves the palm, in lengths of its first phalanx
# Heart, head and life line as (radial, distal) points, millimetres, on the part of the palm between
# these heights.
PALM_LINES_MM = (
    ((-41, 21), (-28, 24), (-14, 27), (0, 32), (9, 37), (14, 44)),
    ((34, 22), (22, 21), (8, 17), (-6, 11), (-18, 3), (-27, -5)),
    ((34, 22), (25, 19), (15, 10), (8, -4), (5, -18), (6, -34)),
)
PALM_HEIGHT_MM = (5.0, 19.0)
NAIL_TINT = np.array([1.10, 1.16, 1.20], dtype=np.float32)


@dataclass(frozen=True)
class Crease:
    """A crease of the skin across a digit.

    It lies in the plane through centre_m [3] perpendicular to the unit vector `axis`, on the side
    of the digit to which `palmar` [3] points, within reach_m of its centre.
    """

    centre_m: np.ndarray
    axis: np.ndarray
    palmar: np.ndarray
    reach_m: float


class Skin:
    """Reflectance of a posed hand's skin, with flexion creases, lines of the palm and nails, as a
    function of points in the hand frame. contrast: strength of texture and creases, 1 as in nature.
    seed: of the texture."""

    def __init__(self, pose: Pose, contrast: float, seed: int, person: Person = MEAN) -> None:
        self.contrast, self.seed, self.palm = contrast, seed, person.palm
        self.hand_from_palm = hand_from_palm(pose)
        bones = skeleton(pose, person)
        self.creases = [
            crease for name, digit in bones.items() for crease in _creases(name, digit, person)
        ]
        self.nails = [(digit[-1], radii_m(name, person)[-1]) for name, digit in bones.items()]

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        """Compute the reflectance [n, 3] (red, green, blue) at points [n, 3] in the hand frame."""
        reflectance = skin(points_m, self.contrast, self.seed)
        wobble_m = WOBBLE_M * solid_noise(points_m, WOBBLE_WAVELENGTH_M, self.seed + 70)
        lines = _palm_lines(points_m @ self.hand_from_palm @ HAND_AXES / self.palm, wobble_m)
        fold = np.maximum(lines, _folds(self.creases, points_m, wobble_m))
        reflectance *= (1 - CREASE_DEPTH * self.contrast * fold)[:, None].astype(np.float32)
        for bone, radius_m in self.nails:
            off_m = points_m - bone.end_m
            near = np.nonzero(np.einsum("ij,ij->i", off_m, off_m) < bone.length_m**2)[0]
            reflectance[near] *= _nail(bone, radius_m, points_m[near])
        return reflectance


def _creases(name: str, digit: tuple[Bone, ...], person: Person) -> list[Crease]:
    flesh_m = radii_m(name, person)
    creases = []
    if name in FINGERS:
        root = digit[1]
        creases.append(
            Crease(root.at(ROOT_CREASE * root.length_m), root.axis, root.palmar, 1.7 * flesh_m[0])
        )
    for inner, outer, radius_m in zip(digit[1:], digit[2:], flesh_m[1:], strict=False):
        axis, palmar = inner.axis + outer.axis, inner.palmar + outer.palmar
        axis, palmar = axis / np.linalg.norm(axis), palmar / np.linalg.norm(palmar)
        shifts_m = (0.0,) if outer is digit[-1] else (-1.3e-3, 1.3e-3)
        creases += [
            Crease(outer.start_m + s * axis, axis, palmar, 1.7 * radius_m) for s in shifts_m
        ]
    return creases


def _folds(creases: list[Crease], points_m: np.ndarray, wobble_m: np.ndarray) -> np.ndarray:
    """Compute the strength [n] of the flexion creases at points [n, 3], 0 (none) to 1. wobble_m
    [n]: displacement of the creases at each point, so that they are not straight."""
    fold = np.zeros(len(points_m))
    for crease in creases:
        _add_crease(
            points_m, wobble_m, crease.centre_m, crease.axis, crease.palmar, crease.reach_m, fold
        )
    return fold


@njit(nogil=True, cache=True)
def _add_crease(
    points_m: np.ndarray,
    wobble_m: np.ndarray,
    centre_m: np.ndarray,
    axis: np.ndarray,
    palmar: np.ndarray,
    reach_m: float,
    fold: np.ndarray,
) -> None:
    """Raise `fold` [n] to at least the strength of one crease (see `Crease`) at points [n, 3]."""
    for n in range(len(points_m)):
        x, y, z = (
            points_m[n, 0] - centre_m[0],
            points_m[n, 1] - centre_m[1],
            points_m[n, 2] - centre_m[2],
        )
        if x * x + y * y + z * z < reach_m**2:
            across_m = x * axis[0] + y * axis[1] + z * axis[2] + wobble_m[n]
            side = (x * palmar[0] + y * palmar[1] + z * palmar[2]) / (0.35 * reach_m)
            strength = min(max(side, 0.0), 1.0) * np.exp(-((across_m / CREASE_WIDTH_M) ** 2))
            fold[n] = max(fold[n], strength)


def _palm_lines(radial_distal_palmar_m: np.ndarray, wobble_m: np.ndarray) -> np.ndarray:
    """Compute the strength [n] of the palm's lines at points [n, 3], 0 (none) to 1. The points are
    (radial, distal, palmar) coordinates, scaled to the mean palm. wobble_m [n]: displacement of the
    lines at each point, so that they are not straight."""
    radial_distal_palmar = 1e3 * radial_distal_palmar_m
    low, high = PALM_HEIGHT_MM
    on_palm = (radial_distal_palmar[:, 2] > low) & (radial_distal_palmar[:, 2] < high)
    on_palm &= radial_distal_palmar[:, 1] < 48
    flat_mm = radial_distal_palmar[on_palm, :2] + 1.5e3 * wobble_m[on_palm, None]
    distance_mm = np.full(len(flat_mm), np.inf)
    for line in PALM_LINES_MM:
        for start, end in itertools.pairwise(line):
            _lower_to_segment(flat_mm, np.array(start, float), np.array(end, float), distance_mm)
    fold = np.zeros(len(radial_distal_palmar))
    fold[on_palm] = np.exp(-((1e-3 * distance_mm / (1.3 * CREASE_WIDTH_M)) ** 2))
    return fold


@njit(nogil=True, cache=True)
def _lower_to_segment(
    points: np.ndarray, start: np.ndarray, end: np.ndarray, distance: np.ndarray
) -> None:
    """Lower `distance` [n] to the distance of points [n, 2] in a plane to the segment from `start`
    to `end`, where that is less."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    for n in range(len(points)):
        x, y = points[n, 0] - start[0], points[n, 1] - start[1]
        t = min(max((x * dx + y * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        distance[n] = min(distance[n], np.sqrt((x - t * dx) ** 2 + (y - t * dy) ** 2))


def _nail(bone: Bone, radius_m: float, points_m: np.ndarray) -> np.ndarray:
    """Compute the factor [n, 3] by which a nail changes the skin's reflectance at points [n, 3]: a
    paler plate with a dark border on the back of the digit's last bone. radius_m: of the
    fingertip."""
    relative = points_m - bone.at(0.80 * bone.length_m)
    along, across = (
        relative @ bone.axis / (0.95 * radius_m),
        relative @ np.cross(bone.axis, bone.palmar),
    )
    outline = (along**4 + (across / (0.72 * radius_m)) ** 4) ** 0.25
    dorsal = relative @ bone.palmar < 0
    plate = np.where(dorsal, np.clip((1 - outline) / 0.08, 0, 1), 0.0)[:, None]
    border = np.where(dorsal, np.exp(-(((outline - 1.02) / 0.05) ** 2)), 0.0)[:, None]
    return ((1 - plate + plate * NAIL_TINT) * (1 - 0.25 * border)).astype(np.float32)
