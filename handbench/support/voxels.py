"""Means of points and their values over cubic voxels."""

import numpy as np


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
