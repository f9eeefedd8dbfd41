"""Mie's series against its limits, and physical optics against it."""

import numpy as np
import pytest

from radar.arrays import AntennaArray
from radar.forward import Scatterers, simulate
from radar.sphere import mie_backscatter, sphere_echo


def test_small_spheres_follow_rayleigh():
    ka = np.array([0.01, 0.02])
    assert np.abs(mie_backscatter(ka)) ** 2 == pytest.approx(9 * ka**4, rel=5e-3)  # next term: about 2.4 (ka)²


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
    # A sphere of 30 mm, ka = 48: physical optics errs by about 1/(2 ka) = 1 % each from specular point and terminator.
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
    optics = simulate(Scatterers(centre + radius * normal[near], area, normal[near]), tones_hz, array)[:, 0, 0]
    exact = sphere_echo(centre, radius, 0.0, tones_hz, array)[:, 0, 0]
    # Near a convex mirror the echo spreads as 1/(R_surface · R_centre), which sphere_echo rounds to the centre's.
    ratio = optics / exact * (0.47 / 0.5)
    assert np.abs(ratio - 1).max() < 0.04
