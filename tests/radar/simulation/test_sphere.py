"""Mie's series against its limits, and physical optics against it."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.physics.spheres import (
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
