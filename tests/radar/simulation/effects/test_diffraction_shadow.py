"""Diffracted shadows: the field behind a straight edge in closed form, and a finger on a plate
against the field past its outline."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erfc

from handbench.bench.scenes.stand import cuboid
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.effects.surfaces import obliquity, room_echoes, shadow
from handbench.radar.simulation.forward import simulate
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.shadows import cubes_of, edge_waves, edges_of, visible_outline
from handbench.support.rays import Rays
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import cylinder, joined, plate, sphere_body
from tests.radar.simulation.effects.small_scenes import shaped
from tests.refusals import refuse

ARRAY = AntennaArray(qar50().tx_m[::9], qar50().rx_m[::11])
TONES_HZ = np.linspace(72e9, 82e9, 12)
FINGER = cylinder((0.0, 0.0, 0.27), 8e-3, 0.06)
# its front is towards the array
SHEET = plate((-0.02, -0.015, 0.30), (0, 0.03, 0), (0.04, 0, 0), 24)
BODY = joined(FINGER, SHEET)


def fields(body, antennas_m, points_m, turns_per_m):
    """The field [a, p] behind a body over that without it, at one tone."""
    rays, edges = Rays(body.vertices_m, body.faces), edges_of(body)
    (order, starts), k = cubes_of(points_m), np.array([2 * np.pi * turns_per_m])
    made = np.empty((len(antennas_m), len(points_m)), np.complex64)
    for field, at_m in zip(made, antennas_m, strict=True):
        outline = visible_outline(body, edges, rays, at_m)
        field[order] = edge_waves(at_m, points_m[order], starts, outline, k)[0]
        field += rays.in_sight(points_m, at_m)
    return made


@pytest.mark.parametrize("behind_m", [0.02, 0.1])
def test_a_straight_edge_is_fresnel_s_knife_edge(behind_m):
    """½ erfc(√(jkδ)) in the shadow of a screen x < 0, with the detour δ past its edge, and 1 less
    that in sight. Waves fade from kδ = 10 on."""
    edge_m, turns_per_m = 0.25, 80e9 / SPEED_OF_LIGHT_M_S
    screen = Body(*cuboid(np.array([[-0.2, -0.1, edge_m], [0, 0.1, edge_m + 1e-3]]), 2e-3))
    far_m, k = edge_m + behind_m, 2 * np.pi * turns_per_m
    angle = np.linspace(-1, 1, 101)[np.arange(101) != 50]
    x_m = angle * np.sqrt(2 * 9 / k * behind_m * far_m / edge_m)
    points_m = np.stack([x_m, 0 * x_m, np.full(100, far_m)], axis=1)
    detour_m = edge_m + np.hypot(x_m, behind_m) - np.hypot(x_m, far_m)
    shadowed = erfc(np.sqrt(1j * k * detour_m)) / 2
    expected = np.where(x_m < 0, shadowed, 1 - shadowed)
    made = fields(screen, np.zeros((1, 3)), points_m, turns_per_m)[0]
    assert np.abs(made - expected).max() < 0.03


def scene(body, tones_hz=TONES_HZ[::3], **values):
    return EchoScene(ARRAY, tones_hz, np.zeros(len(tones_hz)), body, **values)


def facets_of(body, tones_hz=TONES_HZ[::3]):
    """The body's facets, with what each antenna sees of them."""
    return shaped(scene(body, tones_hz), obliquity, shadow).facets


def test_facets_are_weighed_by_the_field_past_the_outline_of_either_leg():
    """2 %: the field is interpolated between samples 2 mm apart, nodes 20 mm apart and three tones;
    differences from full sight below FULL are left out."""
    facets, tone_hz = facets_of(BODY), np.array([80e9])
    turns_per_m = tone_hz / SPEED_OF_LIGHT_M_S
    part = facets.where(np.flatnonzero(facets.face >= len(FINGER.faces))[::58])
    weights = []
    for leg, antennas_m in enumerate((ARRAY.tx_m, ARRAY.rx_m)):
        re, im = part.sight.factors(leg, np.arange(len(antennas_m)), turns_per_m)[0]
        weights.append(re + 1j * im)
        expected = fields(BODY, antennas_m, part.position_m, turns_per_m[0])
        assert relative_error(weights[leg], expected) < 0.02
    lit, samples = replace(part, sight=None), simulate(part, tone_hz, ARRAY, tolerance=None)
    each = [simulate(lit.where([n]), tone_hz, ARRAY, tolerance=None) for n in range(len(part))]
    expected = np.einsum("pftr,tp,rp->ftr", each, *weights)
    assert relative_error(samples, expected) < 1e-5


def test_the_fast_chain_weighs_legs_as_the_plain_sum_does():
    """Within the tolerance, 1e-5: the weights' course over frequency is a parabola, which the tones
    of a leaf carry with the delays of the waves themselves."""
    facets = facets_of(BODY, TONES_HZ)
    fast, plain = (simulate(facets, TONES_HZ, ARRAY, tolerance=t) for t in (1e-5, None))
    assert relative_error(fast, plain) < 1e-5


def test_edges_that_the_body_hides_are_no_outline():
    """Of a thinner finger behind."""
    body = joined(FINGER, cylinder((0.0, 0.0, 0.29), 4e-3, 0.04))
    rays = Rays(body.vertices_m, body.faces)
    outline = visible_outline(body, edges_of(body), rays, np.zeros(3))
    assert len(outline) and outline[:, 2].max() < 0.28


def test_nothing_diffracts_on_a_sheet_alone():
    assert not facets_of(SHEET).sight.partial.any()
    bare, made = (shaped(scene(SHEET), *effects) for effects in ((obliquity,), (obliquity, shadow)))
    np.testing.assert_array_equal(made.samples(), bare.samples())


@pytest.mark.parametrize(
    ("body", "least", "most"),
    [
        (plate((-0.05, -0.05, 0.36), (0, 0.10, 0), (0.10, 0, 0), 20), 0.05, 0.8),
        (plate((0.25, -0.02, 0.36), (0, 0.04, 0), (0.04, 0, 0), 8), 0.0, 0.02),
    ],
    ids=["behind", "aside"],
)
def test_the_room_is_diffracted_behind_the_target_alone(body, least, most):
    """Waves bend around the finger to what is behind it; what stands aside is in full sight;
    without the finger all."""
    echoes = shaped(scene(FINGER, room=(body,)), shadow)
    behind, alone = (room_echoes(echoes, target) for target in (FINGER, None))
    assert least <= relative_error(behind, alone) < most


def test_a_mesh_turned_inside_out_is_refused():
    body = sphere_body(0.01, splits=1)
    refuse(lambda: edges_of(Body(body.vertices_m, body.faces[:, ::-1])), "normals")
