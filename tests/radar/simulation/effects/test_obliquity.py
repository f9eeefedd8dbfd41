"""Obliquity: off, facets scatter evenly; on, by their angle to each antenna."""

import numpy as np
import pytest

from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.scene import Ball
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.simulation.effects.small_scenes import (
    bead_scene,
    effect,
    estimated,
    simulated,
    simulated_change,
)


@pytest.mark.parametrize("on", [False, True])
def test_facets_scatter_evenly_or_by_their_angle(on):
    scene = bead_scene()
    facets = bare_echoes(scene).surface.facets
    optics = Scatterers(facets.position_m, facets.area_m2, facets.normal if on else None)
    expected = simulate(optics, scene.frequencies_hz, scene.array)
    samples = simulated(scene, *(["obliquity"] if on else [])).capture.samples[0]
    assert np.array_equal(samples, expected)


def test_the_estimate_is_what_leaving_it_out_changes():
    scene = bead_scene()
    names = "obliquity", "shadow_centre"
    changes, _ = estimated(scene, *names, without="obliquity")
    change, _ = simulated_change(scene, *names, without="obliquity")
    assert changes["3fsk"].depth_mm == pytest.approx(change.depth_mm, rel=0.2)
    assert changes["3fsk"].depth_mm > 1e-3


def test_balls_have_none():
    scene = bead_scene(target=None, balls=(Ball(np.array([0.0, 0.0, 0.3]), 5e-3),))
    assert effect("obliquity").missing(scene)
    assert effect("obliquity").apply(bare_echoes(scene)).surface is None
