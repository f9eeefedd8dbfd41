"""Exact echoes of a half-plane against what determines them: the wave equation, no field on the
metal, none from far behind the edge, the mirror far before it, and half the field on the shadow's
edge.

The direct field is the dipole's closed form of another module; the mirror is its image."""

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


def test_far_from_its_edge_it_is_a_mirror():
    rx_m = np.array([[-0.03, 0.01, 0.0], [0.05, -0.06, 0.02]])
    image_m = TX_M[0] * [1, 1, -1] + [0, 0, 2 * PLANE.z_m]
    found = scattered_by_half_plane(HalfPlane(-30.0, PLANE.z_m), K, TX_M, rx_m)[0]
    np.testing.assert_allclose(found, -dipole_field(image_m, rx_m, ALONG_Y), rtol=2e-3)


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


def test_on_the_shadow_s_edge_half_the_field_is_left():
    """And it goes over into shadow and light smoothly."""
    behind_m = TX_M[0] + 2 * (np.array([PLANE.x_m, TX_M[0, 1], PLANE.z_m]) - TX_M[0])
    points_m = behind_m + np.outer([-1e-6, 0.0, 1e-6], [1.0, 0.0, 0.0])
    found = total(points_m) / dipole_field(TX_M[0], points_m, ALONG_Y)
    np.testing.assert_allclose(np.abs(found), 0.5, atol=0.02)
    np.testing.assert_allclose(found, found[1], atol=1e-3)
