"""Windows that bend: second derivatives of the disparity."""

import numpy as np
import pytest

from handbench.groundtruth.dense.patchmatch import bends

SIZE = 80
ROW, COLUMN = np.mgrid[:SIZE, :SIZE].astype(float)
INSIDE = np.s_[12:-12, 12:-12]  # four standard deviations of the smoothing from the edges
ALL = np.ones((SIZE, SIZE), bool)


def planes_of(xx=0.0, xy=0.0, yy=0.0, x=0.0, y=0.0):
    """Disparity and its slopes [h, w, 3] of a paraboloid about the middle."""
    dx, dy = COLUMN - SIZE / 2, ROW - SIZE / 2
    disparity = 20 + x * dx + y * dy + (xx * dx**2 + yy * dy**2) / 2 + xy * dx * dy
    return np.stack([disparity, x + xx * dx + xy * dy, y + yy * dy + xy * dx], axis=-1).astype(
        np.float32
    )


@pytest.mark.parametrize("second", [(0.0, 0.0, 0.0), (0.03, 0.01, -0.05)])
def test_a_paraboloid_has_its_second_derivatives(second):
    """Per column², column and row, row²; a symmetric smoothing leaves straight slopes as they are,
    to 32 bits."""
    found = bends(planes_of(*second, x=0.3, y=-0.7), ALL)[INSIDE]
    np.testing.assert_allclose(found, np.broadcast_to(second, found.shape), atol=1e-5)
