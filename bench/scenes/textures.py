"""Solid textures of skin and foam, and marks on a hand: flexion creases, lines of the palm, nails.

A solid texture is a reflectance that depends on a point's position in the body, so that all
photographs show the same pattern.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from handbench.bench.scenes.bones import FINGERS, HAND_AXES, Bone, hand_from_palm, radii_m, skeleton
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.people import MEAN, Person
from handbench.support.compiled import FAST, njit

# linear reflectances
SKIN_RGB, FOAM_RGB, STYRODUR_RGB = np.array(
    [(0.62, 0.36, 0.25), (0.78, 0.78, 0.76), (0.30, 0.42, 0.48)], dtype=np.float32
)

# (wavelength in metres, relative contrast): blotches, mottling, pores and skin ridges.
SKIN_OCTAVES = ((9e-3, 0.030), (4e-3, 0.030), (1.8e-3, 0.035), (0.9e-3, 0.045), (0.5e-3, 0.045))
CREASES = ((2.6e-3, 0.10), (1.2e-3, 0.07))  # fine dark lines where a smooth noise crosses zero
BEAD_M = 2.2e-3  # foam beads
BITS_32 = 0xFFFFFFFF


def skin(points_m: np.ndarray, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of skin at points [n, 3]: a skin tone with faint random
    patterns of 9 to 0.5 mm and fine dark creases. seed: of the patterns."""
    shade = np.zeros(len(points_m), dtype=np.float32)
    for octave, (wavelength_m, amplitude) in enumerate(SKIN_OCTAVES):
        shade += 2.2 * amplitude * solid_noise(points_m, wavelength_m, seed + octave)
    for octave, (wavelength_m, depth) in enumerate(CREASES):
        shade -= depth * np.exp(
            -((solid_noise(points_m, wavelength_m, seed + 50 + octave) / 0.10) ** 2)
        )
    redness = solid_noise(points_m, 14e-3, seed + 90)
    tint = 1 + 0.10 * redness[:, None] * np.array([0.3, -1.0, -0.8], dtype=np.float32)
    return SKIN_RGB * np.exp(shade)[:, None] * tint


def foam(points_m: np.ndarray, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of styrofoam at points [n, 3]: beads of different brightness
    with darker seams. seed: of the pattern."""
    seam, tone = _cells(points_m / BEAD_M, seed)
    seam_m = BEAD_M * seam
    shade = 0.16 * tone - 0.35 * np.exp(-((seam_m / (0.12 * BEAD_M)) ** 2))
    shade += 0.06 * solid_noise(points_m, 0.6e-3, seed + 1)
    return FOAM_RGB * np.exp(shade)[:, None]


def styrodur(points_m: np.ndarray, seed: int) -> np.ndarray:
    """Compute the reflectance [n, 3] of extruded foam board at points [n, 3]: a nearly plain
    blue-grey. seed: of its faint grain."""
    grain = 0.08 * solid_noise(points_m, 2e-3, seed) + 0.06 * solid_noise(
        points_m, 0.8e-3, seed + 1
    )
    return STYRODUR_RGB * np.exp(grain)[:, None]


def solid_noise(points_m: np.ndarray, wavelength_m: float, seed: int) -> np.ndarray:
    """Compute smooth random values [n] (about ±1) at points [n, 3] that vary in space with a
    typical period of wavelength_m. The same seed gives the same values."""
    return _gradient_noise(points_m / wavelength_m, seed)


@njit(inline="always")
def _hash(i: int, j: int, k: int, seed: int) -> int:
    """Return a pseudo-random 32-bit number of the lattice point (i, j, k) for a seed."""
    h = (i * 73856093 ^ j * 19349663 ^ k * 83492791 ^ seed * 2654435761) & BITS_32
    h = (h ^ (h >> 16)) * 0x7FEB352D & BITS_32
    h = (h ^ (h >> 15)) * 0x846CA68B & BITS_32
    return h ^ (h >> 16)


@njit(inline="always")
def _fraction(h: int, shift: int) -> float:
    """Return eight bits of the hash h, starting at bit `shift`, as a number from −1 to 1."""
    return ((h >> shift) & 255) / 127.5 - 1.0


@njit(inline="always")
def _fade(offset: float) -> float:
    """Return the quintic interpolation weight at an offset from a lattice point: 1 at the point, 0
    at its neighbours, with smooth derivatives at both."""
    f = 1 - abs(offset)
    return f * f * f * (10 - 15 * f + 6 * f * f)


@njit(**FAST)
def _gradient_noise(points: np.ndarray, seed: int) -> np.ndarray:
    """Compute Perlin noise, float32 [n] (about ±1), at points [n, 3] in units of its lattice.
    Gradients at lattice points are hashes, interpolated with quintic weights."""
    noise = np.empty(len(points), np.float32)
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
        noise[n] = 1.6 * total
    return noise


@njit(**FAST)
def _cells(points: np.ndarray, seed: int) -> np.ndarray:
    """Divide space into Worley cells, with one random cell centre in each cube of a lattice.

    Returns, float32 [2, n], for points [n, 3] in units of the lattice: the distance to the nearest
    wall of the cell around the point, and the random brightness of that cell, −1 to 1.
    """
    result = np.empty((2, len(points)), np.float32)
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
    return result


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
PALM_SEGMENTS_MM = np.array(
    [segment for line in PALM_LINES_MM for segment in itertools.pairwise(line)], dtype=float
)
PALM_HEIGHT_MM = (5.0, 19.0)
PALM_END_MM = 48.0
NAIL_TINT = np.array([1.10, 1.16, 1.20], dtype=np.float32)


class Crease(NamedTuple):
    """A crease of the skin across a digit.

    It lies in the plane through centre_m [3] perpendicular to the unit vector `axis`, on the side
    of the digit to which `palmar` [3] points, within reach_m of its centre.
    """

    centre_m: np.ndarray
    axis: np.ndarray
    palmar: np.ndarray
    reach_m: float


class Nail(NamedTuple):
    """A nail on the back of a digit.

    It lies within reach_m of its centre centre_m [3]. axes [3, 3]: the columns map a point relative
    to it to coordinates along and across the digit, in which the nail's outline is at 1, and to
    the palmar side.
    """

    centre_m: np.ndarray
    axes: np.ndarray
    reach_m: float


def marked_skin(pose: Pose, seed: int, person: Person = MEAN) -> Callable[[np.ndarray], np.ndarray]:
    """Return the reflectance [n, 3] (red, green, blue) of a posed hand's skin, with flexion
    creases, lines of the palm and nails, as a function of points [n, 3] in the hand frame. seed: of
    the texture."""
    bones = skeleton(pose, person)
    # radial, distal and palmar coordinates, scaled to the mean palm
    palm_mm = 1e3 * hand_from_palm(pose) @ HAND_AXES / person.palm
    creases = [crease for name, digit in bones.items() for crease in _creases(name, digit, person)]
    nails = [_nail(digit[-1], radii_m(name, person)[-1]) for name, digit in bones.items()]

    def reflectance(points_m: np.ndarray) -> np.ndarray:
        result = skin(points_m, seed)
        # so that creases and lines are not straight
        wobble_m = WOBBLE_M * solid_noise(points_m, WOBBLE_WAVELENGTH_M, seed + 70)
        fold = np.zeros(len(points_m))
        _add_palm_lines(points_m @ palm_mm, wobble_m, PALM_SEGMENTS_MM, fold)
        for crease in creases:
            _add_crease(points_m, wobble_m, crease, fold)
        result *= (1 - CREASE_DEPTH * fold)[:, None].astype(np.float32)
        for nail in nails:
            off_m = points_m - nail.centre_m
            near = np.flatnonzero(np.einsum("ij,ij->i", off_m, off_m) < nail.reach_m**2)
            result[near] *= _nail_factor(off_m[near] @ nail.axes)
        return result

    return reflectance


def _creases(name: str, digit: tuple[Bone, ...], person: Person) -> list[Crease]:
    flesh_m, creases = radii_m(name, person), []
    if name in FINGERS:
        root = digit[1]
        creases.append(Crease(root.at(ROOT_CREASE), root.axis, root.palmar, 1.7 * flesh_m[0]))
    for inner, outer, radius_m in zip(digit[1:], digit[2:], flesh_m[1:], strict=False):
        means = (inner.axis + outer.axis, inner.palmar + outer.palmar)
        axis, palmar = (vector / np.linalg.norm(vector) for vector in means)
        for shift_m in (0.0,) if outer is digit[-1] else (-1.3e-3, 1.3e-3):
            centre_m = outer.start_m + shift_m * axis
            creases.append(Crease(centre_m, axis, palmar, 1.7 * radius_m))
    return creases


@njit(**FAST)
def _add_crease(
    points_m: np.ndarray, wobble_m: np.ndarray, crease: Crease, fold: np.ndarray
) -> None:
    """Raise `fold` [n] to at least the strength of a crease at points [n, 3], 0 (none) to 1.
    wobble_m [n]: displacement of the crease at each point."""
    (centre_x, centre_y, centre_z), axis, palmar, reach_m = crease
    for n in range(len(points_m)):
        x, y, z = points_m[n, 0] - centre_x, points_m[n, 1] - centre_y, points_m[n, 2] - centre_z
        if x * x + y * y + z * z < reach_m**2:
            across_m = x * axis[0] + y * axis[1] + z * axis[2] + wobble_m[n]
            side = (x * palmar[0] + y * palmar[1] + z * palmar[2]) / (0.35 * reach_m)
            strength = min(max(side, 0.0), 1.0) * np.exp(-((across_m / CREASE_WIDTH_M) ** 2))
            fold[n] = max(fold[n], strength)


@njit(**FAST)
def _add_palm_lines(
    palm_mm: np.ndarray, wobble_m: np.ndarray, segments_mm: np.ndarray, fold: np.ndarray
) -> None:
    """Raise `fold` [n] to at least the strength of the palm's lines at points, 0 (none) to 1.

    palm_mm [n, 3]: (radial, distal, palmar) coordinates of the points, scaled to the mean palm.
    wobble_m [n]: displacement of the lines at each point. segments_mm [m, 2, 2]: straight parts of
    the lines, from one (radial, distal) point to another.
    """
    low_mm, high_mm = PALM_HEIGHT_MM
    for n in range(len(palm_mm)):
        if low_mm < palm_mm[n, 2] < high_mm and palm_mm[n, 1] < PALM_END_MM:
            shift_mm, nearest_mm2 = 1.5e3 * wobble_m[n], np.inf
            for m in range(len(segments_mm)):
                start, end = segments_mm[m]
                x, y = palm_mm[n, 0] + shift_mm - start[0], palm_mm[n, 1] + shift_mm - start[1]
                dx, dy = end[0] - start[0], end[1] - start[1]
                along = min(max((x * dx + y * dy) / (dx * dx + dy * dy), 0.0), 1.0)
                nearest_mm2 = min(nearest_mm2, (x - along * dx) ** 2 + (y - along * dy) ** 2)
            strength = np.exp(-nearest_mm2 / (1.3e3 * CREASE_WIDTH_M) ** 2)
            fold[n] = max(fold[n], strength)


def _nail(bone: Bone, radius_m: float) -> Nail:
    """Return the nail on the back of a digit's last bone. radius_m: of the fingertip."""
    across = np.cross(bone.axis, bone.palmar) / (0.72 * radius_m)
    axes = np.column_stack([bone.axis / (0.95 * radius_m), across, bone.palmar])
    return Nail(bone.at(0.80), axes, bone.length_m)


def _nail_factor(along_across_palmar: np.ndarray) -> np.ndarray:
    """Compute the factor [n, 3] by which a nail changes the skin's reflectance, a paler plate with
    a dark border, at points [n, 3] in the nail's own coordinates."""
    along, across, palmar = along_across_palmar.T
    outline = np.sqrt(np.sqrt(along**4 + across**4))
    dorsal = palmar < 0
    plate = np.where(dorsal, np.clip((1 - outline) / 0.08, 0, 1), 0.0)[:, None]
    border = np.where(dorsal, np.exp(-(((outline - 1.02) / 0.05) ** 2)), 0.0)[:, None]
    return ((1 - plate + plate * NAIL_TINT) * (1 - 0.25 * border)).astype(np.float32)
