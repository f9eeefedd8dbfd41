"""Signed distances against analytic ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from handbench.bench.scenes.implicit import round_cone

POINT = arrays(np.float64, 3, elements=st.floats(-0.1, 0.1))


@given(POINT)
def test_a_round_cone_is_the_hull_of_its_spheres(point: np.ndarray) -> None:
    start, end, radii = np.array([0.0, -0.02, 0.0]), np.array([0.01, 0.03, 0.0]), (0.012, 0.005)
    t = np.linspace(0, 1, 2001)[:, None]
    distance = np.linalg.norm(point - start - t * (end - start), axis=1)
    # The hull is the union of all spheres between the ends; sampling them costs less than a
    # micrometre.
    expected = (distance - np.linspace(*radii, 2001)).min()
    assert round_cone(start, end, *radii)(point[None])[0] == pytest.approx(expected, abs=1e-6)
