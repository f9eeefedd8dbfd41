"""Simulations against exact solutions, in echoes and in maps: other formulas and other code, from
the geometry on.

The bounds are measured ones plus a tenth: physical optics has no limit that could be derived here.
An effect that comes nearer to the exact echoes adds a row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.physics.reflection import dielectric_permittivity
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import plate
from tests.references.exact.cases import MATERIALS, Case, body
from tests.references.exact.cylinders import ALONG, Cylinder, cylinder_echoes
from tests.references.exact.half_planes import HalfPlane, half_plane_echoes
from tests.references.exact.kept_echoes import against_exact
from tests.references.exact.mie_series import CoatedSphere, sphere_echoes
from tests.references.exact.sphere_clusters import COAT, SCENES, SKIN

CLUSTERS = Path(__file__).parent / "sphere_clusters.npz"
FEW = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])
ONCE = ("obliquity", "shadow")
TWICE = (*ONCE, "multipath")
BOUNDS = (  # scene, material, effects; at most: echo error, mean mm of 2-FSK and 3-FSK
    ("one finger", "skin", ONCE, 0.056, 0.12, 0.044),
    ("finger before palm", "skin", TWICE, 0.17, 0.76, 0.22),
    ("finger before palm, 12 mm aside", "metal", TWICE, 0.22, 3.3, 1.1),
    # without bounces 3-FSK is 0.93 mm off; waves that bounce more often make up the echo error
    ("fingers 6 mm apart", "skin", TWICE, 0.18, 0.33, 0.22),
    ("sphere of 10 mm", "metal", ONCE, 0.059, 0.076, 0.052),
    ("sphere of 10 mm", "skin", ONCE, 0.054, 0.044, 0.035),
    ("sphere of 10 mm", "palm", ONCE, 0.13, 0.21, 0.17),
)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "material", "effects", "echo", "two_mm", "three_mm"), BOUNDS)
def test_a_simulation_is_as_near_as_it_was(scene, material, effects, echo, two_mm, three_mm):
    found = against_exact(scene, material, *effects)
    limits = {"echo_error": echo, "2fsk_mean_mm": two_mm, "3fsk_mean_mm": three_mm}
    assert {name: found[name] for name, limit in limits.items() if found[name] > limit} == {}


@pytest.mark.parametrize("material", ["metal", "skin"])
def test_one_finger_echoes_as_the_exact_series_says(material):
    """Amplitude and phase, nothing fitted. Physical optics leaves out what creeps around,
    polarisation and the angle of Γ: a few percent on a finger (0.06 and 0.07 in an independent
    study of such a finger)."""
    finger, tones_hz = Cylinder(0.0, 0.29, 8e-3), np.array([79.5e9, 82e9])
    case = Case("one finger", (finger,), material, ALONG)
    scene = EchoScene(FEW, tones_hz, np.zeros(2), body(case))
    filling = (
        None if material == "metal" else np.full(2, dielectric_permittivity(MATERIALS[material]))
    )
    effects = ("obliquity", "shadow", *(() if filling is None else ("dielectric",)))
    found = simulate_scene(scene, choose(scene, effects)).capture.samples[0]
    exact = cylinder_echoes([finger], tones_hz, FEW, ALONG, filling)
    assert np.linalg.norm(found - exact) < 0.07 * np.linalg.norm(exact)


def _treams() -> tuple[dict[str, np.ndarray], AntennaArray]:
    with np.load(CLUSTERS) as file:
        return dict(file), AntennaArray(file["tx_m"], file["rx_m"])


@pytest.mark.parametrize("name", ["sphere", "coated sphere"])
def test_the_series_of_a_sphere_is_treams(name):
    """Another program, which shares nothing with the series; its samples are kept in single
    precision."""
    known, array = _treams()
    ((centre_m, radii_m),), _ = SCENES[name]
    tones_hz, coated = known["frequencies_hz"], len(radii_m) > 1
    core, coat = np.full(len(tones_hz), SKIN), np.full(len(tones_hz), COAT) if coated else None
    sphere = CoatedSphere(centre_m, radii_m[-1], radii_m[-1] - radii_m[0] if coated else 0.0)
    found = sphere_echoes(sphere, tones_hz, array, np.array([0.0, 1.0, 0.0]), core, coat)
    expected = known[name.replace(" ", "_")]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "bound"), [("two spheres", 0.13), ("sphere before a larger one", 0.4)]
)
def test_clusters_of_spheres(name, bound):
    known, array = _treams()
    spheres = tuple(CoatedSphere(centre_m, radii_m[-1]) for centre_m, radii_m in SCENES[name][0])
    tones_hz = known["frequencies_hz"]
    scene = EchoScene(
        array, tones_hz, np.zeros(len(tones_hz)), body(Case(name, spheres, "skin", ALONG))
    )
    samples = simulate_scene(scene, choose(scene, (*TWICE, "dielectric"))).capture.samples[0]
    assert relative_error(samples, known[name.replace(" ", "_")]) < bound


def test_a_plate_s_edge():
    """Physical optics' edge against Sommerfeld's; the simulation leaves out the dipoles' pattern
    too."""
    tones_hz = np.array([79.5e9, 82e9])
    body = plate((0.0, -0.16, 0.3), (0.0, 0.32, 0.0), (0.32, 0.0, 0.0), 160)
    scene = EchoScene(FEW, tones_hz, np.zeros(2), body)
    samples = simulate_scene(scene, choose(scene, ("obliquity",))).capture.samples[0]
    assert relative_error(samples, half_plane_echoes(HalfPlane(0.0, 0.3), tones_hz, FEW)) < 0.06
