"""Equal treatments, under which every method gets the same smoothing, and the depth maps that
result."""

from typing import NamedTuple

import numpy as np

WINDOW_PX = 5  # of the averaging filter that all are given
SMOOTHING = {"none": 1, "window": WINDOW_PX}  # treatment → width of every averaging filter, pixels
OPEN_DB = -20.0  # threshold of the maps whose pixels are ordered


class TreatedDepths(NamedTuple):
    """Depth maps of one method on one capture under one equal treatment (same smoothing for all
    methods). All arrays are [ny, nx].
    z_m: depths of the pixels above the method's own threshold, metres; open_z_m: depths of those
    above a low threshold (OPEN_DB, −20 dB, or the method's own if that is lower); NaN elsewhere.
    open_db: amplitudes in dB by which the pixels of open_z_m are ordered."""

    z_m: np.ndarray
    open_z_m: np.ndarray
    open_db: np.ndarray
