"""Mie's series against its limits, and physical optics against it."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.spheres import (
    _spreading_m,
    half_angle_cosine,
    mie_amplitudes,
    sphere_echo,
)
from tests.radar.simulation.effects.closed_forms import mie_backscatter


def test_small_spheres_follow_rayleigh():
    ka = np.array([0.01, 0.02])
    assert np.abs(mie_backscatter(ka)) ** 2 == pytest.approx(
        9 * ka**4, rel=5e-3
    )  # next term: about 2.4 (ka)²


def test_large_spheres_reach_geometrical_optics():
    ka = np.linspace(60, 65, 50)
    echo = mie_backscatter(ka)
    # The specular term's own correction is 1/(2 ka); what remains of creeping waves is smaller.
    assert np.abs(np.abs(echo) - 1).max() < 0.01
    assert np.abs(np.angle(echo * np.exp(-2j * ka))).max() < 1 / 60


def test_resonance_peak_is_where_every_textbook_has_it():
    ka = np.linspace(0.5, 2, 3001)
    cross_section = np.abs(mie_backscatter(ka)) ** 2
    assert ka[cross_section.argmax()] == pytest.approx(1.03, abs=0.01)
    assert cross_section.max() == pytest.approx(3.65, abs=0.03)


def test_physical_optics_over_a_sphere_gives_the_same_echo():
    # A sphere of 30 mm, ka = 48: physical optics errs by about 1/(2 ka) = 1 % each from specular
    # point and terminator.
    centre, radius = np.array([0.0, 0.0, 0.5]), 0.03
    array = AntennaArray(np.array([[0.0, 0.0, 0.0]]), np.array([[0.02, 0.0, 0.0]]))
    count = 400_000
    z = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.pi * (1 + np.sqrt(5)) * (np.arange(count) + 0.5)
    ring = np.sqrt(1 - z**2)
    normal = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    near = normal[:, 2] < 0
    area = np.full(near.sum(), 4 * np.pi * radius**2 / count)
    tones_hz = np.linspace(76e9, 77e9, 5)
    optics = simulate(
        Scatterers(centre + radius * normal[near], area, normal[near]), tones_hz, array
    )[:, 0, 0]
    exact = sphere_echo(centre, radius, 0.0, tones_hz, array)[:, 0, 0]
    # Near a convex mirror the echo spreads as 1/(R_surface · R_centre), which sphere_echo rounds to
    # the centre's.
    ratio = optics / exact * (0.47 / 0.5)
    assert np.abs(ratio - 1).max() < 0.04


def test_bistatic_amplitudes_conserve_energy():
    """A conductor absorbs nothing: what is scattered into all directions, ∫(|S₁|² + |S₂|²) sin θ dθ
    / x², is what is taken from the wave, 4/x² · Re S(0) (optical theorem)."""
    x = np.array([1.5, 8.0, 17.0])
    theta, weight = np.polynomial.legendre.leggauss(200)
    theta, weight = np.pi / 2 * (theta + 1), np.pi / 2 * weight
    scale = x[:, None] / 2j  # amplitudes are 2j/x·S
    across, along = (scale * f for f in mie_amplitudes(x, np.sin(theta / 2)))
    scattered = ((np.abs(across) ** 2 + np.abs(along) ** 2) * np.sin(theta)) @ weight / x**2
    forward = (scale * mie_amplitudes(x, np.zeros(1))[0])[:, 0]
    np.testing.assert_allclose(scattered, 4 / x**2 * forward.real, rtol=1e-10)


def test_the_field_decides_which_amplitude_a_channel_sees():
    """Antennas along x: a field along y lies across the plane of scattering; one along x in it. A
    field half-way sees the mean, and so does a channel whose polarisation is not known."""
    array = AntennaArray(
        np.array([[-0.07, 0.0, 0.0]]), np.array([[0.05, 0.0, 0.0], [0.06, 0.0, 0.0]])
    )
    centre, radius, tones_hz = np.array([0.01, 0.0, 0.3]), 0.005, np.array([72e9, 77e9])
    across, along = mie_amplitudes(
        2 * np.pi * tones_hz / 299_792_458.0 * radius, half_angle_cosine(centre, array)[0]
    )

    def ratio(field):
        echo = sphere_echo(centre, radius, 0.0, tones_hz, array, field)[:, 0]
        return echo / sphere_echo(centre, radius, 0.0, tones_hz, array, np.array([0.0, 1, 0]))[:, 0]

    np.testing.assert_allclose(ratio(np.array([1.0, 0, 0])), along / across, rtol=1e-4)
    for field in (np.array([1.0, 1, 0]), None):
        # fields are projected across each ray, which shortens the one in the plane: second order in
        # 13°
        np.testing.assert_allclose(ratio(field), (1 + along / across) / 2, rtol=5e-3)


def test_echoes_of_a_sphere_are_reciprocal():
    array = AntennaArray(np.array([[-0.07, 0.02, 0.0]]), np.array([[0.05, -0.03, 0.0]]))
    swapped = AntennaArray(array.rx_m, array.tx_m)
    centre, tones_hz, field = (
        np.array([0.01, 0.02, 0.3]),
        np.linspace(72e9, 82e9, 5),
        np.array([0.6, 0.8, 0]),
    )
    there, back = (
        sphere_echo(centre, 0.005, 1e-4, tones_hz, a, field).ravel() for a in (array, swapped)
    )
    np.testing.assert_allclose(there, back, rtol=1e-5)


def traced_m(angle_rad, distance_m, radius_m, n):
    """Where a ray [2] that leaves the origin at an angle to the way to a ball's middle comes back
    to the origin's plane: by Snell's law through the ball's front, off its back and out again, or
    off its front (n is None)."""
    middle_m, at_m, way = (
        np.array([distance_m, 0.0]),
        np.zeros(2),
        np.array([np.cos(angle_rad), np.sin(angle_rad)]),
    )

    def reach(at_m, way, inside):
        off_m = at_m - middle_m
        along_m = -off_m @ way
        half_m = np.sqrt(along_m**2 - off_m @ off_m + radius_m**2)
        at_m = at_m + (along_m + half_m if inside else along_m - half_m) * way
        return at_m, (at_m - middle_m) / radius_m

    def refracted(way, outward, ratio):
        normal = -np.sign(way @ outward) * outward
        cosine = -way @ normal
        return ratio * way + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal

    at_m, outward = reach(at_m, way, False)
    if n is not None:
        way = refracted(way, outward, 1 / n)
        at_m, outward = reach(at_m, way, True)
    way = way - 2 * (way @ outward) * outward
    if n is not None:
        at_m, outward = reach(at_m, way, True)
        way = refracted(way, outward, n)
    return (at_m - at_m[0] / way[0] * way)[1]


@pytest.mark.parametrize("n", [None, 1.02, 1.3, 1.6])
@pytest.mark.parametrize(("distance_m", "radius_m"), [(0.3, 0.02), (0.25, 0.05)])
def test_rays_spread_as_traced_ones_do(distance_m, radius_m, n):
    """Off the front and over the back of a ball, near its axis."""
    legs_m = [np.array([distance_m])] * 2
    found_m = _spreading_m(legs_m, radius_m, 1.0 if n is None else n, n is not None).item()
    angle_rad = 1e-6
    assert abs(found_m) == pytest.approx(
        abs(traced_m(angle_rad, distance_m, radius_m, n)) / angle_rad, rel=1e-5
    )
