"""Reflection of skin: published values, limits of the layered half-space, and the palm's bias in
depth."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.effects.surfaces import skin
from handbench.radar.simulation.reflection import (
    echo_reflections,
    interface,
    layer_reflection,
    skin_permittivity,
)
from handbench.radar.simulation.scene import Material
from tests.radar.simulation.effects.small_scenes import (
    bead_scene,
    depth_shift_m,
    explained,
    shaped,
    simulated,
)

TONE_HZ = np.array([77e9])


def db(amplitude):
    return 20 * np.log10(np.abs(amplitude))


@pytest.mark.parametrize(
    ("tone_hz", "expected", "reflected_db"),
    [(72e9, 6.9 - 9.4j, -4.6), (77e9, 6.6 - 8.9j, -4.7), (82e9, 6.3 - 8.5j, -4.8)],
)
def test_dry_skin_as_published(tone_hz, expected, reflected_db):
    """Two digits are known of real and imaginary part."""
    permittivity = skin_permittivity(np.array([tone_hz]))
    assert permittivity[0] == pytest.approx(expected, abs=0.08)
    assert db(interface(1.0, permittivity))[0, 0] == pytest.approx(reflected_db, abs=0.06)


@pytest.mark.parametrize(
    ("wet", "permittivity"), [(False, [1133.6, 1119.2, 990.76]), (True, [29010.0, 15357.0, 1832.8])]
)
def test_every_dispersion_of_skin_is_the_tabulated_one(wet, permittivity):
    """Gabriel's models at 10 kHz, 100 kHz and 1 MHz as table 3 of doi 10.1186/s12938-018-0473-9 has
    them (five digits): there the slow dispersions count, which millimetre waves hardly feel."""
    real = skin_permittivity(np.array([1e4, 1e5, 1e6]), wet).real
    assert real == pytest.approx(permittivity, rel=1e-4)


@pytest.mark.parametrize(
    ("thickness_m", "reflected_db", "within_db"),
    [(15e-6, -4.8, 0.1), (140e-6, -5.8, 0.1), (430e-6, -18, 2.5)],
)
def test_horny_layers_as_published(thickness_m, reflected_db, within_db):
    """430 µm is close to a quarter wave: a deep minimum, which the second digit of a permittivity
    moves by decibels."""
    palm = Material(kind="skin", palm_thickness_m=thickness_m)
    reflection = echo_reflections(palm, TONE_HZ)[1]
    assert db(reflection)[0] == pytest.approx(reflected_db, abs=within_db)


def test_a_quarter_wave_of_the_geometric_mean_matches():
    quarter_m = SPEED_OF_LIGHT_M_S / TONE_HZ[0] / 4 / np.sqrt(2)
    matched = layer_reflection(np.array([2.0]), np.array([4.0]), quarter_m, TONE_HZ)
    assert abs(matched[0, 0]) < 1e-12
    # A lossless mirror at depth d returns all, e^{−2jkn₁d} later: the sign of e^{+jωt}.
    deep = layer_reflection(np.array([1.0]), np.array([1e12]), 1e-3, TONE_HZ)
    expected = -np.exp(-4j * np.pi * TONE_HZ[0] / SPEED_OF_LIGHT_M_S * 1e-3)
    assert deep[0, 0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("cosine", [1.0, 0.7, 0.2])
def test_layers_at_an_angle_have_their_limits(cosine):
    """A layer of the half-space's own medium, and of no thickness, is the half-space at any angle;
    at normal incidence both polarisations agree."""
    skin_, other = np.array([6.4 - 8.6j]), np.array([3.0])
    bare = interface(1.0, skin_, cosine)
    for layer, thickness_m in ((skin_, 1e-3), (other, 0.0)):
        layered = layer_reflection(layer, skin_, thickness_m, TONE_HZ, cosine)
        np.testing.assert_allclose(layered, bare, atol=1e-12)
    both = layer_reflection(other, skin_, 1e-4, TONE_HZ, cosine)
    assert np.allclose(both[0], both[1], atol=1e-12) == (cosine == 1)


@pytest.mark.parametrize(
    ("palm", "thickness_m", "bias_m"),
    [(False, 430e-6, 0.04e-3), (True, 140e-6, 0.15e-3), (True, 430e-6, 2.6e-3)],
)
def test_the_palm_seems_further_away(palm, thickness_m, bias_m):
    bead, material = bead_scene().target, Material(kind="skin", palm_thickness_m=thickness_m)
    scene = bead_scene(target=replace(bead, material=material, palm=np.full(len(bead.faces), palm)))
    metal, skinned = (simulated(scene, "obliquity", *more).capture for more in ((), ("skin",)))
    change_m = depth_shift_m(metal, skinned)
    assert change_m == pytest.approx(bias_m, abs=0.05e-3)
    row = explained(scene, "obliquity", "skin")["skin"]
    assert row.depth_mm == pytest.approx(1e3 * change_m, rel=0.05)  # exact for one layer


def test_each_face_has_its_own_layer():
    bead = bead_scene().target
    palm = bead.vertices_m[bead.faces].mean(axis=1)[:, 0] < 0.01
    scene = bead_scene(target=replace(bead, material=Material(kind="skin"), palm=palm))
    np.testing.assert_array_equal(shaped(scene, skin).layers == 1, palm)
