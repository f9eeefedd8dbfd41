"""The radii of balls against what is known exactly. The hard cases compare the balls' formulas with
other code."""

from __future__ import annotations

import numpy as np

from tests.references import balls as b


def test_a_difference_is_never_given_too_small():
    """1/3 and √2 are no floats: the distance to the nearest one is known, and a nan is infinitely
    far."""
    third = b.balls(1.0) / 3
    assert 1.8e-17 < b.off(1 / 3, third) < 1.9e-17
    assert b.off(np.nan, third) == np.inf and b.off(1.0, b.balls(0.0) / 0) == np.inf
    wide = third.union(third + 1)
    assert 1 <= b.off(1 / 3, wide) < 1.001
