"""Decisions that an image's tolerance leaves open, made by the exact sum.

A projection asks an image which voxel along z is the strongest, and which pixels are above the threshold. Where two
candidates differ by less than the image's error allows for, both are imaged exactly; elsewhere the answer is the exact
image's already. A faster image thus leads to the same map, unless it leaves three voxels of a pixel in doubt.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from handbench.radar.imaging.peaks import Peaks

# Times the voxels' root mean square error, that a difference of two must exceed. Errors gather where the image is
# bright: above -13 dB of a point in a large box they were 2.2 times as large on average (measured, at 1e-3).
SURE = 8.0

Exact = Callable[[np.ndarray, np.ndarray], np.ndarray]


def settled(peaks: Peaks, threshold_db: float, exact: Exact, beside: int = 0) -> Peaks:
    """The peaks whose strongest voxels, where pixels are at or above the threshold, are those of the exact image.

    exact: flat pixel index [n] and voxel index along z [n] → magnitude [n] in the exact image. beside: voxels along z,
    where the magnitudes beside a voxel that another gives way to are asked for, too; else they are NaN.
    """
    doubt = SURE * peaks.error
    if doubt == 0:
        return peaks
    shape, height = peaks.index.shape, peaks.magnitude[1].ravel()
    index, rival, second = peaks.index.flatten(), peaks.rival.ravel(), peaks.second.ravel()
    floor = height.max() * 10 ** (threshold_db / 20)
    rivalled = (height - second <= doubt) & (height >= floor - doubt) & (rival >= 0)
    paired = np.flatnonzero(rivalled)
    single = np.flatnonzero(((np.abs(height - floor) <= doubt) | (height >= height.max() - doubt)) & ~rivalled)
    places = index[single], index[paired], rival[paired]
    found = exact(np.concatenate([single, paired, paired]), np.concatenate(places))
    alone, own, other = np.split(found, [len(single), len(single) + len(paired)])
    magnitude = peaks.magnitude.reshape(3, -1).copy()
    magnitude[1, single], magnitude[1, paired] = alone, np.maximum(own, other)
    moved = paired[other > own]
    index[moved] = rival[moved]
    place = index[moved] + np.array([[-1], [1]])
    within = (place >= 0) & (place < beside)
    around = np.full(place.shape, np.nan)
    if within.any():
        around[within] = exact(np.broadcast_to(moved, place.shape)[within], place[within])
    magnitude[[[0], [2]], moved] = around
    return replace(peaks, index=index.reshape(shape), magnitude=magnitude.reshape(3, *shape))
