"""The equal treatments: every method with the same thresholds and filters; and the depth maps that
they give."""

from typing import NamedTuple

import numpy as np

WINDOW_PX = 5  # of the averaging filter that all are given
SMOOTHING = {"none": 1, "window": WINDOW_PX}  # treatment → width of every averaging filter, pixels
OPEN_DB = -20.0  # threshold of the maps whose pixels are ordered


class TreatedDepths(NamedTuple):
    """A method's depths on one capture under one equal treatment (thresholds and smoothing the same
    for all methods), all [ny, nx].
    z_m: depths above the method's own threshold; open_z_m: depths above the lower threshold
    OPEN_DB; metres, NaN elsewhere. open_db: amplitudes by which the pixels of open_z_m are
    ordered."""

    z_m: np.ndarray
    open_z_m: np.ndarray
    open_db: np.ndarray
