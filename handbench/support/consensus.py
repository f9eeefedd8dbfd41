"""The majority of points that agree on one transform (least trimmed squares over triples of points,
Rousseeuw 1984)."""

from collections.abc import Callable
from itertools import combinations
from math import comb

import numpy as np

TRIPLES = comb(12, 3)  # largest number of triples; beyond 12 points they are drawn at random
MAJORITY = 0.6  # share of points that must agree before another is called wrong


def nearest_majority(
    count: int,
    needed: int,
    usable: Callable[[np.ndarray], bool],
    residuals: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Return the indices [needed] of the points that agree best with one transform.

    Each triple of points proposes a transform; the best one has the smallest sum of squared
    residuals over the `needed` points that fit it best. usable: returns True if the points with
    these indices determine a transform; residuals: returns the residuals [count] of all points
    under the transform that the points with these indices determine. Without any usable triple,
    all points are returned.
    """
    best, least = np.arange(count), np.inf
    for triple in _triples(count):
        if usable(triple):
            squares = residuals(triple) ** 2
            nearest = np.argsort(squares, kind="stable")[:needed]
            if squares[nearest].sum() < least and usable(nearest):
                best, least = nearest, squares[nearest].sum()
    return best


def _triples(count: int) -> np.ndarray:
    """Return triples of indices below `count`: [m, 3]. They are all triples or, if there are more
    than TRIPLES, as many random ones, which are the same in every run."""
    if comb(count, 3) <= TRIPLES:
        return np.array(list(combinations(range(count), 3)))
    rng = np.random.default_rng(0)  # the same points give the same transform
    return np.array([rng.choice(count, 3, replace=False) for _ in range(TRIPLES)])
