"""People: how a person's hand differs from the mean hand, and how the person places it.

Sizes, by sex: Gordon et al. (1989), 1988 Anthropometric Survey of U.S. Army Personnel
(Natick/TR-89/044): hand length (wrist crease to the middle finger's tip) and breadth (across the
knuckles) with their standard deviations. Two values are from the first 29 men of the public ANSUR
II data (Gordon et al. 2014, Natick/TR-15/007): the correlation of length and breadth, r = 0.74,
taken as 0.7, and the scatter of the palm's length for a given hand length, 2.4 %.

Bones: Buryanov & Kotiuk (2010), Proportions of hand segments, Int. J. Morphol. 28(3): the means,
and for each bone a standard deviation of 8 to 15 %, which includes the size of the hand and the
error of the radiographs. Relative lengths of the fingers: the ratio of index and ring finger has a
standard deviation of 3 % (Manning et al. 1998, Hum. Reprod. 13), here 2.5 % for each finger.

handbench's own estimates: phalanges relative to each other 5 %, girth (of the fingers, and of the
palm's thickness) for a given breadth 4 %, of each finger 1.5 %, of the palm 3 %; and the placement
of the hand (`placement`).
"""

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

# Mean bone lengths, millimetres: metacarpal, then the phalanges outwards.
LENGTHS_MM = {
    "thumb": (46.2, 31.6, 21.7),
    "index": (68.1, 39.8, 22.4, 15.8),
    "middle": (64.6, 44.6, 26.3, 17.4),
    "ring": (58.0, 41.4, 25.7, 17.3),
    "little": (53.7, 32.7, 18.1, 16.0),
}
MEAN_MM = (189.2, 83.4)  # hand length and breadth of the mean hand's mesh
# men, women: length, breadth: mean, deviation
SIZES_MM = (((193.8, 9.8), (90.4, 4.2)), ((180.5, 9.7), (79.4, 3.8)))
BREADTH_WITH_LENGTH = 0.7
# Deviations of logarithms.
PALM, FINGER, PHALANX, GIRTH, FINGER_GIRTH, THICKNESS = 0.024, 0.025, 0.05, 0.04, 0.015, 0.03
GIRTH_WITH_BREADTH = 0.7  # exponent
TAILS = (0.02, 0.98)  # of every distribution: nothing rarer is drawn
MOST_PEOPLE = 999_999
# deviations of the placement
DISTANCE_M, OFFSET_M, TILT_DEG = (0.005, (0.006, 0.008), (4.0, 4.0, 3.0))


@dataclass(frozen=True)
class Person:
    """A person's hand, as factors on the mean hand. palm: on positions in (radial, distal, palmar)
    direction on the palm, wrist and forearm; its last factor also on their thickness. bones: on the
    lengths of each digit's bones, by its name; girth: on each digit's radii."""

    palm: tuple[float, float, float]
    bones: dict[str, tuple[float, ...]]
    girth: dict[str, float]

    def __hash__(self) -> int:
        return hash(repr(self))


MEAN = Person(
    (1.0, 1.0, 1.0),
    {name: (1.0,) * len(own) for name, own in LENGTHS_MM.items()},
    dict.fromkeys(LENGTHS_MM, 1.0),
)


def _deviates(generator: np.random.Generator, *shape: int) -> np.ndarray:
    """Draw random numbers `shape` of a normal distribution of mean 0 and standard deviation 1 whose
    lowest and highest 2 % are cut off."""
    from scipy.special import ndtri

    return ndtri(generator.uniform(*TAILS, shape))


@cache
def person(number: int) -> Person:
    """Return the hand of the person `number`, drawn at random with this seed, always the same for a
    number. 0 is the mean hand."""
    if number == 0:
        return MEAN
    generator = np.random.default_rng((number, 1))
    draws = partial(_deviates, generator)
    (length_mm, length_spread), (breadth_mm, breadth_spread) = SIZES_MM[generator.integers(2)]
    tall, wide = draws(2)
    wide = BREADTH_WITH_LENGTH * tall + np.sqrt(1 - BREADTH_WITH_LENGTH**2) * wide
    length = (length_mm + length_spread * tall) / MEAN_MM[0]
    breadth = (breadth_mm + breadth_spread * wide) / MEAN_MM[1]
    palm = length * np.exp(PALM * draws(1)[0])
    girth = breadth**GIRTH_WITH_BREADTH * np.exp(GIRTH * draws(1)[0])
    bones, girths = {}, {}
    for name, mean_mm in LENGTHS_MM.items():
        outer_mm = np.array(mean_mm[1:] if name != "thumb" else mean_mm)
        own = PHALANX * draws(len(outer_mm))
        # the digit's length is drawn separately
        own += FINGER * draws(1) - own @ outer_mm / outer_mm.sum()
        factors = length * np.exp(own)
        bones[name] = tuple(map(float, factors if name == "thumb" else (palm, *factors)))
        girths[name] = float(girth * np.exp(FINGER_GIRTH * draws(1)[0]))
    thick = girth * np.exp(THICKNESS * draws(1)[0])
    return Person((float(breadth), float(palm), float(thick)), bones, girths)


@dataclass(frozen=True)
class HandPlacement:
    """How far a person's hand is from where its scene places the mean hand. distance_m: farther
    away; offset_m: in x and y; tilt_deg: turns about the x, y and z axes."""

    distance_m: float
    offset_m: tuple[float, float]
    tilt_deg: tuple[float, float, float]


def placement(number: int, seed: int) -> HandPlacement:
    """Draw how the person `number` holds the hand in a scene with this seed, always the same for
    both. The spreads are handbench's estimates for people who are shown where to hold it."""
    drawn = _deviates(np.random.default_rng((number, 2, seed)), 6) * (
        DISTANCE_M,
        *OFFSET_M,
        *TILT_DEG,
    )
    distance_m, x_m, y_m, *tilt_deg = map(float, drawn)
    return HandPlacement(distance_m, (x_m, y_m), (tilt_deg[0], tilt_deg[1], tilt_deg[2]))
