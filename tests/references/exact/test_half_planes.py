"""Exact echoes of a half-plane against what determines them: the wave equation, and no field on the
metal. Their size is compared in `test_simulations.py`.

The direct field is the dipole's closed form of another module."""

from __future__ import annotations

import numpy as np
import pytest

from tests.references.exact.dipole_fields import K, dipole_field
from tests.references.exact.half_planes import HalfPlane, scattered_by_half_plane

PLANE = HalfPlane(0.0, 0.3)
ALONG_Y = np.array([0.0, 1.0, 0.0])
TX_M = np.array([[0.05, 0.02, 0.0]])


def total(points_m):
    """The field [n] of the first transmitter and of what the half-plane scatters."""
    return scattered_by_half_plane(PLANE, K, TX_M, points_m)[0] + dipole_field(
        TX_M[0], points_m, ALONG_Y
    )


def test_no_field_on_the_metal():
    """A nanometre before it the dipole and its image, 0.3 m away, differ by 2k · 1 nm/0.3 m."""
    points_m = np.array(
        [
            [x, y, PLANE.z_m + side]
            for x in (0.01, 0.1)
            for y in (0.0, 0.04)
            for side in (-1e-9, 1e-9)
        ]
    )
    assert np.abs(total(points_m)).max() < 1.2 * 2 * K * 1e-9 / PLANE.z_m


@pytest.mark.parametrize(
    "middle", [[0.02, -0.03, 0.1], [-0.1, 0.01, 0.35], [0.06, 0.03, 0.4], [-0.06, 0.02, 0.3]]
)
def test_it_obeys_the_wave_equation(middle):
    """Before the metal, beside it, in its shadow, and level with it: ∇²E = −k²E by differences of
    the fourth order."""
    step_m = 0.05 / K
    offsets = np.array([0, *(s * n for n in (1, 2) for s in (-1, 1))])
    laplacian = 0
    for axis in np.eye(3):
        e = total(np.array(middle) + step_m * offsets[:, None] * axis)
        laplacian = laplacian + (-30 * e[0] + 16 * (e[1] + e[2]) - (e[3] + e[4])) / (12 * step_m**2)
    here = total(np.array([middle]))[0]
    assert laplacian == pytest.approx(-(K**2) * here, abs=2e-4 * K**2 * np.abs(here))
