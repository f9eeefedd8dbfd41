"""Functions of vectors as tuples of three numbers, for compiled code, where tuples stay in
registers."""

from __future__ import annotations

import numpy as np

from handbench.support.compiled import njit


@njit(inline="always")
def vec(array):  # type: ignore[no-untyped-def]
    """Return the three numbers of an array [3] as a tuple."""
    return array[0], array[1], array[2]


@njit(inline="always")
def minus(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(inline="always")
def ahead(start, length, way):  # type: ignore[no-untyped-def]
    return start[0] + length * way[0], start[1] + length * way[1], start[2] + length * way[2]


@njit(inline="always")
def dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(inline="always")
def norm(a):  # type: ignore[no-untyped-def]
    return np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@njit(inline="always")
def direction(a):  # type: ignore[no-untyped-def]
    """Return the unit vector along `a`, and the length of `a`."""
    length = norm(a)
    scale = 1 / max(length, 1e-30)
    return (a[0] * scale, a[1] * scale, a[2] * scale), length


@njit(inline="always")
def mirrored(incoming, normal):  # type: ignore[no-untyped-def]
    return ahead(incoming, -2 * dot(incoming, normal), normal)
