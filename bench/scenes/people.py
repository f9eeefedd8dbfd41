"""People: how a person's hand differs from the mean hand, and how the person holds it.

Hand length (wrist crease to the middle finger's tip) and breadth (across the knuckles) of men and
women, with standard deviations: Gordon et al. (1989), 1988 Anthropometric Survey of U.S. Army
Personnel (Natick/TR-89/044). Two values are from the first 29 men of the public ANSUR II data
(Gordon et al. 2014, Natick/TR-15/007): the correlation of length and breadth, r = 0.74, rounded to
0.7 here, and the scatter of the palm's length for a given hand length, 2.4 %.

Mean lengths of the bones: Buryanov & Kotiuk (2010), Proportions of hand segments, Int. J. Morphol.
28(3). Their standard deviations of 8 to 15 % are not used, since they include the size of the hand
and the error of the radiographs. Instead, each finger's length relative to the hand varies by 2.5
%, because the ratio of index and ring finger has a standard deviation of 3 % (Manning et al. 1998,
Hum. Reprod. 13).

handbench's own estimates of standard deviations: phalanges relative to each other 5 %, girth (of
the fingers, and of the palm's thickness) for a given breadth 4 %, girth of each finger 1.5 %,
thickness of the palm 3 %, and how the hand is held (`placement`).
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
SHIFT_M, TILT_DEG = (0.006, 0.008, 0.005), (4.0, 4.0, 3.0)


@dataclass(frozen=True)
class Person:
    """A person's hand, as factors on the mean hand.

    palm: factors on radial, distal and palmar coordinates of palm, wrist and forearm; the last one
    is also the factor on their thickness. bones: factors on the lengths of each digit's bones, by
    the digit's name. girth: factor on each digit's radii, by the digit's name.
    """

    palm: tuple[float, float, float]
    bones: dict[str, tuple[float, ...]]
    girth: dict[str, float]


MEAN = Person(
    (1.0, 1.0, 1.0),
    {name: (1.0,) * len(own) for name, own in LENGTHS_MM.items()},
    dict.fromkeys(LENGTHS_MM, 1.0),
)


def _deviates(generator: np.random.Generator, *shape: int) -> np.ndarray:
    """Draw random numbers of the given shape from a normal distribution of mean 0 and standard
    deviation 1, without its lowest and highest 2 %."""
    from scipy.special import ndtri

    return ndtri(generator.uniform(*TAILS, shape))


@cache
def person(number: int) -> Person:
    """Return the hand of the person `number`. It is drawn at random with the number as seed, so
    that a number always means the same hand; 0 is the mean hand."""
    if number == 0:
        return MEAN
    generator = np.random.default_rng((number, 1))
    draws = partial(_deviates, generator)
    (length_mm, length_spread), (breadth_mm, breadth_spread) = SIZES_MM[generator.integers(2)]
    tall, wide = draws(2)
    wide = BREADTH_WITH_LENGTH * tall + np.sqrt(1 - BREADTH_WITH_LENGTH**2) * wide
    length = (length_mm + length_spread * tall) / MEAN_MM[0]
    breadth = (breadth_mm + breadth_spread * wide) / MEAN_MM[1]
    palm = length * np.exp(PALM * draws())
    girth = breadth**GIRTH_WITH_BREADTH * np.exp(GIRTH * draws())
    bones, girths = {}, {}
    for name, mean_mm in LENGTHS_MM.items():
        outer_mm = np.array(mean_mm[1:] if name != "thumb" else mean_mm)
        own = PHALANX * draws(len(outer_mm))
        # the digit's length is drawn separately
        own += FINGER * draws() - own @ outer_mm / outer_mm.sum()
        factors = length * np.exp(own)
        bones[name] = tuple(map(float, factors if name == "thumb" else (palm, *factors)))
        girths[name] = float(girth * np.exp(FINGER_GIRTH * draws()))
    thick = girth * np.exp(THICKNESS * draws())
    return Person((float(breadth), float(palm), float(thick)), bones, girths)


def placement(number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw how the person `number` holds the hand in a scene with this seed.

    Returns by how much the hand is displaced from the position that the scene gives the mean hand,
    [x, y, z] in metres, and turned about the x, y and z axes [3], degrees. The same number and seed
    always give the same result. The spreads are handbench's estimates for people who are shown
    where to hold their hand.
    """
    distance, *offset = _deviates(np.random.default_rng((number, 2, seed)), 6)
    return np.array([*offset[:2], distance]) * SHIFT_M, np.array(offset[2:]) * TILT_DEG
