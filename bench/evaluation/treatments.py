"""The treatments that make methods equal, and the maps that a method has under one of them."""

from typing import NamedTuple

import numpy as np

WINDOW_PX = 5  # of the averaging filter that all are given
SMOOTHING = {"none": 1, "window": WINDOW_PX}  # treatment → width of every averaging filter, pixels
OPEN_DB = -20.0  # threshold of the maps whose pixels are ordered


class TreatedDepths(NamedTuple):
    """A method's depths of one capture under one treatment, all [ny, nx]: z_m above its own
    threshold, open_z_m above OPEN_DB, NaN elsewhere; open_db: the amplitude by which these are
    ordered."""

    z_m: np.ndarray
    open_z_m: np.ndarray
    open_db: np.ndarray
