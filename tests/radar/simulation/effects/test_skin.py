"""Reflection of skin: published values, limits of the layered half-space, and the palm's bias in
depth."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.simulation.effects.materials import skin
from handbench.radar.simulation.physics.reflection import (
    echo_reflections,
    interface,
    layer_reflection,
    skin_permittivity,
)
from handbench.radar.simulation.scene import Material
from tests.radar.simulation.effects.plates import sphere_body
from tests.radar.simulation.effects.small_scenes import (
    bead_scene,
    depth_shift_m,
    explained,
    shaped,
    simulated,
)

SKIN = Material(kind="skin")


def db(amplitude):
    return 20 * np.log10(np.abs(amplitude))


@pytest.mark.parametrize(
    ("tone_hz", "expected", "reflected_db"),
    [(72e9, 6.9 - 9.4j, -4.6), (77e9, 6.6 - 8.9j, -4.7), (82e9, 6.3 - 8.5j, -4.8)],
)
def test_dry_skin_as_published(tone_hz, expected, reflected_db):
    permittivity = skin_permittivity(np.array([tone_hz]))
    assert permittivity[0] == pytest.approx(
        expected, abs=0.08
    )  # two digits are known of real and imaginary part
    assert db(interface(1.0, permittivity))[0, 0] == pytest.approx(reflected_db, abs=0.06)


@pytest.mark.parametrize(
    ("thickness_m", "reflected_db", "within_db"),
    [(15e-6, -4.8, 0.1), (140e-6, -5.8, 0.1), (430e-6, -18, 2.5)],
)
def test_horny_layers_as_published(thickness_m, reflected_db, within_db):
    # 430 µm is close to a quarter wave: a deep minimum, which the second digit of a permittivity
    # moves by decibels.
    palm = Material(kind="skin", palm_thickness_m=thickness_m)
    reflection = echo_reflections(palm, np.array([77e9]))[1]
    assert db(reflection)[0] == pytest.approx(reflected_db, abs=within_db)


def test_a_quarter_wave_of_the_geometric_mean_matches():
    tone_hz, below = np.array([77e9]), np.array([4.0])
    quarter_m = 299_792_458.0 / 77e9 / 4 / np.sqrt(2)
    assert abs(layer_reflection(np.array([2.0]), below, quarter_m, tone_hz)[0, 0]) < 1e-12
    # A lossless mirror at depth d returns all, e^{−2jkn₁d} later: the sign of e^{+jωt}.
    deep = layer_reflection(np.array([1.0]), np.array([1e12]), 1e-3, tone_hz)
    assert deep[0, 0] == pytest.approx(-np.exp(-4j * np.pi * 77e9 / 299_792_458.0 * 1e-3), abs=1e-5)


@pytest.mark.parametrize(
    ("palm", "thickness_m", "bias_m"),
    [(False, 430e-6, 0.04e-3), (True, 140e-6, 0.15e-3), (True, 430e-6, 2.6e-3)],
)
def test_the_palm_seems_further_away(palm, thickness_m, bias_m):
    body = sphere_body(4e-3, (0.01, -0.005, 0.3))
    material = Material(kind="skin", palm_thickness_m=thickness_m)
    scene = bead_scene(target=replace(body, material=material, palm=np.full(len(body.faces), palm)))
    change_m = depth_shift_m(
        simulated(scene, "obliquity").capture, simulated(scene, "obliquity", "skin").capture
    )
    assert change_m == pytest.approx(bias_m, abs=0.05e-3)
    row = explained(scene, "obliquity", "skin")["skin"]
    assert row.depth_mm == pytest.approx(1e3 * change_m, rel=0.05)  # exact for one layer


def test_each_face_has_its_own_layer():
    body = sphere_body(4e-3, (0.01, -0.005, 0.3))
    left = body.vertices_m[body.faces].mean(axis=1)[:, 0] < 0.01
    scene = bead_scene(target=replace(body, material=SKIN, palm=left))
    state = shaped(scene, skin)
    assert np.array_equal(state.layers == 1, left)


@pytest.mark.parametrize(
    ("wet", "permittivity"), [(False, [1133.6, 1119.2, 990.76]), (True, [29010.0, 15357.0, 1832.8])]
)
def test_every_dispersion_of_skin_is_the_tabulated_one(wet, permittivity):
    """Gabriel's models at 10 kHz, 100 kHz and 1 MHz as table 3 of doi 10.1186/s12938-018-0473-9 has
    them (five digits): there the slow dispersions count, which millimetre waves hardly feel."""
    assert skin_permittivity(np.array([1e4, 1e5, 1e6]), wet).real == pytest.approx(
        permittivity, rel=1e-4
    )
