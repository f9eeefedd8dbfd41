"""Exact echoes of a half-plane against what determines them: the wave equation, and no field on the
metal. Their size is compared in `test_simulations.py`."""

from itertools import product

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from tests.references.exact.half_planes import HalfPlane, scattered_by_half_plane

K = 2 * np.pi * 30e9 / SPEED_OF_LIGHT_M_S
PLANE = HalfPlane(0.0, 0.3)
TX_M = np.array([[0.05, 0.02, 0.0]])


def total(points_m):
    """The field [n] along y of the transmitter, in the textbook's closed form, and of what the
    half-plane scatters."""
    away_m = points_m - TX_M
    r = np.linalg.norm(away_m, axis=1)
    cosine2, near = (away_m[:, 1] / r) ** 2, (1 + 1j * K * r) / (K * r) ** 2
    direct = np.exp(-1j * K * r) / r * (1 - cosine2 - near * (1 - 3 * cosine2))
    return direct + scattered_by_half_plane(PLANE, K, TX_M, points_m)[0]


def test_no_field_on_the_metal():
    """A nanometre before it the dipole and its image, 0.3 m away, differ by 2k · 1 nm/0.3 m."""
    sides_m = PLANE.z_m + 1e-9, PLANE.z_m - 1e-9
    points_m = np.array(list(product((0.01, 0.1), (0.0, 0.04), sides_m)))
    assert np.abs(total(points_m)).max() < 1.2 * 2 * K * 1e-9 / PLANE.z_m


@pytest.mark.parametrize(
    "middle", [(0.02, -0.03, 0.1), (-0.1, 0.01, 0.35), (0.06, 0.03, 0.4), (-0.06, 0.02, 0.3)]
)
def test_it_obeys_the_wave_equation(middle):
    """Before the metal, beside it, in its shadow, and level with it: ∇²E = −k²E by differences of
    the fourth order."""
    step_m, laplacian = 0.05 / K, 0
    for axis in np.eye(3):
        e = total(np.array(middle) + step_m * np.arange(-2, 3)[:, None] * axis)
        laplacian = laplacian + e @ [-1, 16, -30, 16, -1] / (12 * step_m**2)
    assert laplacian == pytest.approx(-(K**2) * e[2], abs=2e-4 * K**2 * np.abs(e[2]))
