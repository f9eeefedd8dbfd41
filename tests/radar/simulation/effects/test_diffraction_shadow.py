"""Diffracted shadows of a finger on a plate: against a sum over facets in float64, and
properties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.ablation import Ablation
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.effects.clutter import _seen_behind
from handbench.radar.simulation.effects.target_surface import (
    obliquity,
    shadow_antennas,
    shadow_diffraction,
)
from handbench.radar.simulation.forward import simulate
from handbench.radar.simulation.physics.creeping import DEEP, LIT, pekeris
from handbench.radar.simulation.physics.diffraction import FARTHEST, WIDEST
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes
from handbench.support.rays import Rays
from tests.radar.simulation.effects.plates import cylinder, joined, plate

FULL = qar50()
ARRAY = AntennaArray(FULL.tx_m[::9], FULL.rx_m[::11])
TONES_HZ = np.array([72e9, 75e9, 79.5e9, 82e9])
FINGER = cylinder((0.0, 0.0, 0.27), 8e-3, 0.06, along=30)
SHEET = plate(
    (-0.02, -0.015, 0.30), (0, 0.03, 0), (0.04, 0, 0), 24
)  # its front is towards the array
BODY = joined(FINGER, SHEET)
XI = np.linspace(LIT, DEEP, 400)
PEKERIS = XI, pekeris(XI, np.zeros(1), np.ones(1))[:, 0]  # of metal, for a field along the edge


def state(body, array=ARRAY, effect=shadow_diffraction, tones_hz=TONES_HZ) -> Echoes:
    return effect(obliquity(bare_echoes(EchoScene(array, tones_hz, np.zeros(len(tones_hz)), body))))


def smooth_step(x):
    return np.clip(x, 0, 1) ** 2 * (3 - 2 * np.clip(x, 0, 1))


def field(points_m, antenna_m):
    """V + (1/2π) Σ ∫ e^{−jkδ} dφ − Σ ∫ m p*(mθ)/√π e^{−jkδ} dl/L [f, p] in float64 behind the
    finger as a cylinder: its outline are the two lines along y where planes through the antenna
    touch it, in pieces of 0.2 mm, and δ is longer by the arc aθ³/6. The field of dipoles along y is
    along them. The fades are those of the formula's limits."""
    to_axis = np.array([0.0, 0.27]) - antenna_m[[0, 2]]
    far2 = to_axis @ to_axis
    across = 8e-3 * np.sqrt(far2 - 8e-3**2) / far2 * np.array([-to_axis[1], to_axis[0]])
    height_m = np.linspace(-0.03, 0.03, 301)
    starts_m, ends_m, normals = [], [], []
    for side in (1, -1):  # on the left upwards, on the right downwards
        x, z = np.array([0.0, 0.27]) - 8e-3**2 / far2 * to_axis + side * across
        normals += [[x / 8e-3, 0.0, (z - 0.27) / 8e-3]] * 300
        line_m = np.stack([np.full(301, x), side * height_m, np.full(301, z)], axis=1) - antenna_m
        starts_m.append(line_m[:-1])
        ends_m.append(line_m[1:])
    start_m, end_m, normal = np.concatenate(starts_m), np.concatenate(ends_m), np.array(normals)
    middle_m = (start_m + end_m) / 2
    sine2 = 1 - middle_m[:, 1] ** 2 / (middle_m**2).sum(axis=1)  # of the ray's angle to the axis
    middle_hz = (TONES_HZ.min() + TONES_HZ.max()) / 2
    size = np.cbrt(
        np.pi * middle_hz / SPEED_OF_LIGHT_M_S * 8e-3 / sine2
    )  # m, whose a is that along the ray
    lengths_m = np.linalg.norm(end_m - start_m, axis=1) * np.sqrt(sine2)
    waves = np.zeros((len(TONES_HZ), len(points_m)), complex)
    for n, point_m in enumerate(points_m):
        way_m = np.linalg.norm(point_m - antenna_m)
        along = (point_m - antenna_m) / way_m
        flat = along[[0, 2]]
        nearest = to_axis @ flat / (flat @ flat)  # m along the ray to where it passes the axis
        hidden = (
            np.linalg.norm(to_axis - nearest * flat) < 8e-3
            and abs(antenna_m[1] + nearest * along[1]) < 0.03
        )
        one, other = (leg - (leg @ along)[:, None] * along for leg in (start_m, end_m))
        turned = np.arctan2(np.cross(other, one) @ along, (one * other).sum(axis=1)) / (2 * np.pi)
        before_m, off_m = (start_m + end_m) @ along / 2, np.linalg.norm(one + other, axis=1) / 2
        behind_m = way_m - before_m
        detour_m = np.hypot(before_m, off_m) + np.hypot(behind_m, off_m) - way_m
        turned *= 1 - smooth_step(2 * off_m / behind_m / WIDEST - 1)
        leaving_m = point_m - antenna_m - middle_m
        xi = np.clip(
            -size * np.arcsin((leaving_m * normal).sum(axis=1) / np.linalg.norm(leaving_m, axis=1)),
            LIT,
            DEEP,
        )
        spread = 1 / np.hypot(before_m, off_m) + 1 / np.hypot(behind_m, off_m)
        fade = (1 - smooth_step(2 * off_m / behind_m / WIDEST - 1)) * smooth_step(2 - 2 * xi / LIT)
        creeping = -size / np.sqrt(np.pi) * np.interp(xi, *PEKERIS) * lengths_m * spread * fade
        late = 4 * np.pi * middle_hz / SPEED_OF_LIGHT_M_S * detour_m / FARTHEST - 1
        detour_m = detour_m + SPEED_OF_LIGHT_M_S / (6 * np.pi * middle_hz) * xi**3 * smooth_step(
            2 - 2 * xi / LIT
        )
        phase = 2 * np.pi * TONES_HZ[:, None] / SPEED_OF_LIGHT_M_S * detour_m
        waves[:, n] = ((turned + creeping) * (1 - smooth_step(late)) * np.exp(-1j * phase)).sum(
            axis=1
        )
        waves[:, n] += not hidden
    return waves


def test_echoes_are_the_sum_over_facets_of_the_outline_s_field():
    """S = Σ A g_t D_t g_r D_r e^{−jk(R_t + R_r)} in numpy, of every 58th facet of the sheet. 2 %: D
    is interpolated between samples 2 mm apart, nodes 20 mm apart and three tones, differences from
    full sight below FULL are left out, and the finger's mesh is a prism."""
    made = state(BODY)
    facets = made.surface.facets
    chosen = np.flatnonzero(facets.face >= len(FINGER.faces))[::58]
    part = facets.where(chosen)
    found = simulate(replace(part.optics, sight=made.surface.sight.where(chosen)), TONES_HZ, ARRAY)
    legs = []
    for antennas_m in (ARRAY.tx_m, ARRAY.rx_m):
        leg = []
        for antenna_m in antennas_m:
            towards_m = antenna_m - part.position_m
            way_m = np.linalg.norm(towards_m, axis=1)
            gain = np.sqrt(np.maximum((towards_m * part.normal).sum(axis=1) / way_m, 0)) / way_m
            steered = np.exp(-2j * np.pi * TONES_HZ[:, None] / SPEED_OF_LIGHT_M_S * way_m)
            leg.append(gain * steered * field(part.position_m, antenna_m))
        legs.append(np.stack(leg, axis=1))
    expected = np.einsum("ftp,frp->ftr", legs[0] * part.area_m2, legs[1])
    assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected)
    sharp = np.linalg.norm(state(BODY, effect=shadow_antennas).echo(ARRAY) - made.echo(ARRAY))
    assert sharp > 0.1 * np.linalg.norm(made.echo(ARRAY))


def test_the_fast_chain_weighs_legs_as_the_plain_sum_does():
    """Within the tolerance, 1e-5: the weights' course over frequency is a parabola, which the tones
    of a leaf carry with the delays of the waves themselves."""
    surface = state(BODY, tones_hz=np.linspace(72e9, 82e9, 24)).surface
    optics = replace(surface.facets.optics, sight=surface.sight)
    fast, plain = (
        simulate(optics, np.linspace(72e9, 82e9, 24), ARRAY, tolerance=t) for t in (1e-5, None)
    )
    assert np.linalg.norm(fast - plain) < 1e-5 * np.linalg.norm(plain)


def test_transmitters_and_receivers_may_change_places():
    there = state(BODY)
    back = state(BODY, AntennaArray(ARRAY.rx_m, ARRAY.tx_m))
    np.testing.assert_allclose(
        back.echo(back.array).transpose(0, 2, 1), there.echo(ARRAY), atol=1e-6
    )


def test_nothing_diffracts_on_a_sheet_alone():
    bare, made = (
        obliquity(bare_echoes(EchoScene(ARRAY, TONES_HZ, np.zeros(4), SHEET))),
        state(SHEET),
    )
    assert not made.surface.sight.partial.any()
    np.testing.assert_array_equal(made.echo(ARRAY), bare.echo(ARRAY))


def test_the_shadow_s_edge_is_smooth():
    """Along a line across the sheet, sharp shadows jump by 1; the field by no more than Fresnel's
    slope, 1/√(λd/2) per metre (d = 30 mm behind the finger: 0.14 per millimetre, doubled between
    two edges)."""
    made = state(BODY)
    facets, sight = made.surface.facets, made.surface.sight
    line = np.flatnonzero(
        (facets.face >= len(FINGER.faces)) & (np.abs(facets.position_m[:, 1]) < 4e-4)
    )
    line = line[np.argsort(facets.position_m[line, 0])]
    across_m = facets.position_m[line, 0]
    weights = sight.where(line).weights(0, 80e9 / SPEED_OF_LIGHT_M_S)
    assert np.abs(weights).min() < 0.5 and np.abs(weights).max() > 1.0
    steps = np.abs(np.diff(weights, axis=1))
    assert (steps <= 0.05 + 280 * np.diff(across_m)).all()


def test_an_ablation_tells_the_size_of_the_change():
    scene = EchoScene(FULL, np.array([79.5e9, 82e9]), np.zeros(2), BODY)
    shadows = [
        effect for effect in EFFECTS if effect.id in ("shadow_antennas", "shadow_diffraction")
    ]
    told_db = Ablation(scene, shadows, CONTAINED).level_db({"shadow_diffraction"})
    sharp, soft = (
        state(BODY, FULL, effect, scene.frequencies_hz).samples
        for effect in (shadow_antennas, shadow_diffraction)
    )
    level_db = 20 * np.log10(np.linalg.norm(soft - sharp) / np.linalg.norm(sharp))
    assert told_db == pytest.approx(level_db, abs=6)


def test_the_room_is_diffracted_behind_the_target_alone():
    """Waves bend around the finger to what is behind it; what stands aside is in full sight;
    without the finger all."""
    wall = plate((-0.05, -0.05, 0.36), (0, 0.10, 0), (0.10, 0, 0), 20)
    aside = plate((0.25, -0.02, 0.36), (0, 0.04, 0), (0.04, 0, 0), 8)
    scene = EchoScene(ARRAY, TONES_HZ, np.zeros(4), FINGER, room=(wall, aside))
    with_finger, without = (
        shadow_diffraction(bare_echoes(scene, levels=levels)) for levels in (None, {})
    )
    every = joined(FINGER, wall, aside)
    rays = Rays(every.vertices_m, every.faces)
    behind, beside = (_seen_behind(with_finger, rays, body) for body in (wall, aside))
    assert behind.sight.partial.any() and not beside.sight.partial.any()
    weights = np.abs(behind.sight.weights(0, 80e9 / SPEED_OF_LIGHT_M_S))
    assert weights.min() < 0.5 and 1 < weights.max() < 1.6
    assert _seen_behind(without, rays, aside).sight is None
