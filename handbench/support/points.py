"""Points in space: their means over voxels, and the majority that agrees on one transform (least
trimmed squares over triples of points, Rousseeuw 1984)."""

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
    if comb(count, 3) <= TRIPLES:
        triples = [np.array(triple) for triple in combinations(range(count), 3)]
    else:
        rng = np.random.default_rng(0)  # the same points give the same transform
        triples = [rng.choice(count, 3, replace=False) for _ in range(TRIPLES)]
    for triple in triples:
        if usable(triple):
            squares = residuals(triple) ** 2
            nearest = np.argsort(squares, kind="stable")[:needed]
            if squares[nearest].sum() < least and usable(nearest):
                best, least = nearest, squares[nearest].sum()
    return best


def voxels(points_m: np.ndarray, size_m: float, shift: np.ndarray | float = 0.0) -> np.ndarray:
    """Number the occupied cubic voxels of side size_m, from 0: the number of each point's voxel
    [n], for points [n, 3]. shift: shift of the voxels' lattice, as a share of their side."""
    index = np.floor((points_m - points_m.min(axis=0)) / size_m + shift).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index.T), tuple(index.max(axis=0) + 1))
    return np.unique(flat, return_inverse=True)[1]


def mean_by(voxel: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the mean of `values` [n, …] over the points in each of m voxels: [m, …]. voxel [n]:
    from `voxels`."""
    count = np.bincount(voxel)
    columns = values.reshape(len(voxel), -1).T
    means = [np.bincount(voxel, weights=column) / count for column in columns]
    return np.stack(means, axis=1).reshape(-1, *values.shape[1:])
