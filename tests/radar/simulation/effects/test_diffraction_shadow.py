"""Diffracted shadows of a finger on a plate: against the field past its outline, and properties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.effects.clutter import room_echoes
from handbench.radar.simulation.effects.target_surface import obliquity, shadow
from handbench.radar.simulation.forward import simulate
from handbench.radar.simulation.physics.shadows import (
    cubes_of,
    edge_waves,
    edges_of,
    visible_outline,
)
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes
from handbench.support.rays import Rays
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import cylinder, joined, plate
from tests.radar.simulation.effects.small_scenes import shaped

FULL = qar50()
ARRAY = AntennaArray(FULL.tx_m[::9], FULL.rx_m[::11])
TONES_HZ = np.array([72e9, 75e9, 79.5e9, 82e9])
FINGER = cylinder((0.0, 0.0, 0.27), 8e-3, 0.06, along=30)
SHEET = plate(
    (-0.02, -0.015, 0.30), (0, 0.03, 0), (0.04, 0, 0), 24
)  # its front is towards the array
BODY = joined(FINGER, SHEET)


def state(body, array=ARRAY, effect=shadow, tones_hz=TONES_HZ) -> Echoes:
    return shaped(EchoScene(array, tones_hz, np.zeros(len(tones_hz)), body), obliquity, effect)


def factors(sight, leg, antennas, turns):
    """Complex factors [a, p] of a leg's antennas at one tone."""
    re, im = sight.factors(leg, np.arange(antennas), np.array([turns]))[0]
    return re + 1j * im


def test_facets_are_weighed_by_the_field_past_the_outline_of_either_leg():
    """2 %: the field is interpolated between samples 2 mm apart, nodes 20 mm apart and three tones;
    differences from full sight below FULL are left out. The field itself is compared in
    `physics/`."""
    made, turns = state(BODY), 80e9 / SPEED_OF_LIGHT_M_S
    facets, rays = made.facets, Rays(BODY.vertices_m, BODY.faces)
    chosen = np.flatnonzero(facets.face >= len(FINGER.faces))[::58]
    order, starts = cubes_of(facets.position_m[chosen])
    part, edges = facets.where(chosen[order]), edges_of(BODY)
    weights = []
    for leg, antennas_m in enumerate((ARRAY.tx_m, ARRAY.rx_m)):
        fields = []
        for at_m in antennas_m:
            outline = visible_outline(BODY, edges, rays, at_m)
            wavenumber = np.array([2 * np.pi * turns])
            waves = edge_waves(at_m, part.position_m, starts, outline, wavenumber)
            fields.append(rays.in_sight(part.position_m, at_m) + waves[0])
        weights.append(factors(part.sight, leg, len(antennas_m), turns))
        assert np.linalg.norm(weights[leg] - fields) < 0.02 * np.linalg.norm(fields)
    tone_hz = np.array([80e9])
    lit, found = replace(part, sight=None), simulate(part, tone_hz, ARRAY, tolerance=None)
    each = [simulate(lit.where([n]), tone_hz, ARRAY, tolerance=None) for n in range(len(chosen))]
    expected = np.einsum("pftr,tp,rp->ftr", each, *weights)
    assert np.linalg.norm(found - expected) < 1e-5 * np.linalg.norm(expected)


def test_the_fast_chain_weighs_legs_as_the_plain_sum_does():
    """Within the tolerance, 1e-5: the weights' course over frequency is a parabola, which the tones
    of a leaf carry with the delays of the waves themselves."""
    optics = state(BODY, tones_hz=np.linspace(72e9, 82e9, 24)).facets
    fast, plain = (
        simulate(optics, np.linspace(72e9, 82e9, 24), ARRAY, tolerance=t) for t in (1e-5, None)
    )
    assert np.linalg.norm(fast - plain) < 1e-5 * np.linalg.norm(plain)


def test_nothing_diffracts_on_a_sheet_alone():
    bare = shaped(EchoScene(ARRAY, TONES_HZ, np.zeros(4), SHEET), obliquity)
    made = state(SHEET)
    assert not made.facets.sight.partial.any()
    np.testing.assert_array_equal(made.samples(), bare.samples())


def test_the_room_is_diffracted_behind_the_target_alone():
    """Waves bend around the finger to what is behind it; what stands aside is in full sight;
    without the finger all."""
    wall = plate((-0.05, -0.05, 0.36), (0, 0.10, 0), (0.10, 0, 0), 20)
    aside = plate((0.25, -0.02, 0.36), (0, 0.04, 0), (0.04, 0, 0), 8)
    for body, least, most in ((wall, 0.05, 0.8), (aside, 0.0, 0.02)):
        echoes = shaped(EchoScene(ARRAY, TONES_HZ, np.zeros(4), FINGER, room=(body,)), shadow)
        behind, alone = (room_echoes(echoes, target) for target in (FINGER, None))
        assert least <= relative_error(behind, alone) < most
