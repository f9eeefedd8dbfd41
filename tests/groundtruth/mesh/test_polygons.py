"""Polygons become the triangles that they are, whatever their shape and order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.groundtruth.mesh.polygons import triangles

CROSSED = np.array([(0, 0), (1, 1), (1, 0), (0, 1)], float)
UNEVEN = [[0, 0], [0, 0.3], [0, 0], [0, 0]]
PENTAGRAM = np.array([(np.cos(a), np.sin(a)) for a in 4 * np.pi / 5 * np.arange(5)])


@given(st.integers(0, 2**32 - 1), st.integers(4, 60), st.floats(0, 0.8))
def test_triangles_of_a_star_cover_it_once_from_every_first_corner(seed, count, depth):
    rng = np.random.default_rng(seed)
    angle, radius = 2 * np.pi * np.arange(count) / count, 1 + depth * rng.uniform(-1, 1, count)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = np.stack([x, y, 0 * x], axis=1) @ turn.T + rng.normal(size=3)
    normal = turn[:, 2] * np.linalg.det(turn)
    shoelace = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    found = []
    for first in (0, 1, count // 2):
        faces = triangles(points, [np.roll(np.arange(count), first)[None]])
        one, two = (points[faces[:, k]] - points[faces[:, 0]] for k in (1, 2))
        along = np.cross(one, two) / 2 @ normal
        assert (along > -1e-9).all() and along.sum() == pytest.approx(shoelace, rel=1e-9)
        found.append({tuple(sorted(face)) for face in faces.tolist()})
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("shape", [CROSSED, CROSSED * [1, 2] + UNEVEN, PENTAGRAM])
def test_a_polygon_that_crosses_itself_is_refused(shape):
    with pytest.raises(ValueError, match="crosses itself"):
        triangles(np.pad(shape, ((0, 0), (0, 1))), [np.arange(len(shape))[None]])
