"""Simulations against exact solutions, in echoes and in maps: other formulas and other code, from
the geometry on.

The bounds are measured ones plus a tenth: physical optics has no limit that could be derived here.
An effect that comes nearer to the exact echoes adds a row."""

from pathlib import Path

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import plate
from tests.references.exact.cases import SCENES, body, exact_echoes
from tests.references.exact.kept_echoes import against_exact
from tests.references.exact.mie_series import CoatedSphere, sphere_echoes

# Before dipoles along y: spheres by the T-matrices of treams (Beutel, Fernandez-Corbaton,
# Rockstuhl, Comput. Phys. Commun. 297 (2024) 109076), made by `sphere_clusters.py` of commit
# d67b8e8a; a metal half-plane at z = 0.3 m from x = 0 on by Sommerfeld's solution, made by
# `half_planes.py` of commit fed65f85, which `test_half_planes.py` of commit 21ae856c holds against
# the wave equation.
KEPT = Path(__file__).with_name("kept_echoes.npz")
SKIN, COAT = 6.4 * (1 - 1.35j), 3.2 - 0.6j  # time e^{+jωt}
SPHERES = {
    "sphere": (CoatedSphere((0.0, 0.0, 0.29), 8e-3),),
    "coated_sphere": (CoatedSphere((0.01, -0.02, 0.29), 8e-3, coat_m=0.3e-3),),
    "two_spheres": (
        CoatedSphere((-0.011, 0.0, 0.29), 8e-3),
        CoatedSphere((0.011, 0.0, 0.29), 8e-3),
    ),
}
TONES_HZ = np.array([79.5e9, 82e9])
FEW = AntennaArray(qar50().tx_m[::24], qar50().rx_m[::24])
ONCE = ("obliquity", "shadow")
TWICE = (*ONCE, "multipath")
BOUNDS = (  # scene, material, effects; at most: echo error, mean mm of 2-FSK and 3-FSK
    ("one finger", "skin", ONCE, 0.056, 0.12, 0.044),
    ("finger before palm", "skin", TWICE, 0.17, 0.76, 0.22),
    # without bounces 3-FSK is 0.93 mm off; waves that bounce more often make up the echo error
    ("fingers 6 mm apart", "skin", TWICE, 0.18, 0.33, 0.22),
    ("sphere of 10 mm", "skin", ONCE, 0.054, 0.044, 0.035),
    ("sphere of 10 mm", "palm", ONCE, 0.13, 0.21, 0.17),
)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "material", "effects", "echo", "two_mm", "three_mm"), BOUNDS)
def test_a_simulation_is_as_near_as_it_was(scene, material, effects, echo, two_mm, three_mm):
    limits = {"echo_error": echo, "2fsk_mean_mm": two_mm, "3fsk_mean_mm": three_mm}
    errors = against_exact(scene, material, *effects)
    assert {name: errors[name] for name, most in limits.items() if errors[name] > most} == {}


def simulated(body, tones_hz, array, *effects):
    """Samples [f, t, r] of the simulation."""
    scene = EchoScene(array, tones_hz, np.zeros(len(tones_hz)), body)
    return simulate_scene(scene, choose(scene, effects)).capture.samples[0]


def test_one_finger_echoes_as_the_exact_series_says():
    """Amplitude and phase, nothing fitted. Physical optics leaves out what creeps around,
    polarisation and the angle of Γ: a few percent on a finger (0.07 in an independent study of such
    a finger)."""
    finger = SCENES["one finger"]
    samples = simulated(body(finger, "skin"), TONES_HZ, FEW, *ONCE, "dielectric")
    assert relative_error(samples, exact_echoes(finger, "skin", TONES_HZ, FEW)) < 0.07


def kept(name):
    """Samples [f, t, r] of a scene of KEPT, its tones and antennas."""
    with np.load(KEPT) as file:
        return file[name], file["frequencies_hz"], AntennaArray(file["tx_m"], file["rx_m"])


@pytest.mark.parametrize(("name", "coat"), [("sphere", None), ("coated_sphere", COAT)])
def test_the_series_of_a_sphere_is_treams(name, coat):
    """Another program, which shares nothing with the series; its samples are kept in single
    precision."""
    expected, tones_hz, array = kept(name)
    fillings = (filling and np.full(len(tones_hz), filling) for filling in (SKIN, coat))
    samples = sphere_echoes(*SPHERES[name], tones_hz, array, np.eye(3)[1], *fillings)
    np.testing.assert_allclose(samples, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_two_spheres():
    expected, tones_hz, array = kept("two_spheres")
    samples = simulated(body(SPHERES["two_spheres"], "skin"), tones_hz, array, *TWICE, "dielectric")
    assert relative_error(samples, expected) < 0.13


def test_a_plate_s_edge():
    """Physical optics' edge against Sommerfeld's; the simulation leaves out the dipoles' pattern
    too."""
    expected, tones_hz, array = kept("plate_edge")
    body = plate((0.0, -0.16, 0.3), (0.0, 0.32, 0.0), (0.32, 0.0, 0.0), 160)
    assert relative_error(simulated(body, tones_hz, array, "obliquity"), expected) < 0.055
