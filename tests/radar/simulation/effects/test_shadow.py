"""Shadows against the formula: rays from every antenna to every facet."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.effects.quick_estimate import visible_from
from handbench.radar.simulation.effects.target_surface import (
    estimate_shadow_antennas,
    obliquity,
    shadow_antennas,
    shadow_centre,
)
from handbench.radar.simulation.physics.facets import face_vectors
from handbench.radar.simulation.physics.line_of_sight import facets_in_sight, lines, rays_of
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes, front_facets
from handbench.support.errors import HandbenchError
from handbench.support.rays import Rays
from tests.radar.simulation.effects.plates import cylinder, joined, plate
from tests.radar.simulation.effects.small_scenes import TONES_HZ, sphere_body

FINGERS = joined(cylinder((0.0, 0.0, 0.30), 8e-3, 0.05), cylinder((0.014, 0.0, 0.33), 8e-3, 0.05))
SHEET = plate((-0.04, -0.03, 0.3), (0, 0.06, 0), (0.08, 0, 0), 40)  # its front is towards the array


def scene(body: Body, array: AntennaArray | None = None) -> EchoScene:
    return EchoScene(array or qar50(), TONES_HZ, np.zeros(3), body)


def state(body: Body, *effects) -> Echoes:
    made = obliquity(bare_echoes(scene(body)))
    for effect in effects:
        made = effect(made)
    return made


def by_rays(body: Body, facets, antennas_m) -> np.ndarray:
    rays = Rays(body.vertices_m, body.faces)
    towards = face_vectors(body.vertices_m, body.faces)[facets.face]
    front = [
        ((a - body.vertices_m[body.faces[facets.face, 0]]) * towards).sum(axis=1) > 0
        for a in antennas_m
    ]
    return np.array(
        [f & rays.in_sight(facets.position_m, a) for f, a in zip(front, antennas_m, strict=True)]
    )


def test_what_antennas_see_agrees_with_a_ray_to_every_facet():
    here = scene(FINGERS)
    facets = front_facets(here, FINGERS)
    antennas_m = np.concatenate([here.array.tx_m, here.array.rx_m])[::2]
    seen = facets_in_sight(rays_of(here, FINGERS), FINGERS, facets, antennas_m)
    expected = by_rays(FINGERS, facets, antennas_m)
    partly = expected.any(axis=0) & ~expected.all(axis=0)
    assert partly.mean() > 0.3
    # 2e-4 of all pairs of a hand: what is narrower than a face may be missed.
    assert (seen != expected).mean() < 5e-4


def test_a_coarse_face_in_the_shadow_of_something_small_is_asked_facet_by_facet():
    body = joined(
        plate((-0.02, -0.02, 0.3), (0, 0.04, 0), (0.04, 0, 0), 1), sphere_body(3e-3, (0, 0, 0.28))
    )
    here = scene(body)
    facets = front_facets(here, body)
    antennas_m = here.array.tx_m[::7]
    seen = facets_in_sight(rays_of(here, body), body, facets, antennas_m)
    on_plate = facets.face < 2
    expected = by_rays(body, facets, antennas_m)[:, on_plate]
    assert 0.9 < expected.mean() < 0.999
    assert (seen[:, on_plate] != expected).mean() < 5e-4


def test_echoes_with_shadows_leave_out_what_is_hidden():
    alone = state(joined(cylinder((0.0, 0.0, 0.30), 8e-3, 0.05)), shadow_antennas)
    # A small ball right behind the cylinder is hidden from all antennas: no echo of it is left.
    hidden = state(
        joined(cylinder((0.0, 0.0, 0.30), 8e-3, 0.05), sphere_body(2e-3, (0, 0, 0.315))),
        shadow_antennas,
    )
    assert np.array_equal(hidden.echo(hidden.array), alone.echo(alone.array))


def test_shadows_from_the_centre_keep_what_it_sees():
    made = state(FINGERS, shadow_centre)
    facets = front_facets(made.scene, FINGERS)
    expected = by_rays(FINGERS, facets, np.zeros((1, 3)))[0]
    assert np.array_equal(made.surface.facets.position_m, facets.position_m[expected])
    assert made.surface.seen is None


def test_shadows_of_antennas_supersede_those_of_the_centre():
    both, one = state(FINGERS, shadow_centre, shadow_antennas), state(FINGERS, shadow_antennas)
    assert np.array_equal(both.echo(both.array), one.echo(one.array))


def test_nothing_hides_a_sheet():
    bare = state(SHEET)
    for effect in (shadow_centre, shadow_antennas):
        made = state(SHEET, effect)
        assert np.array_equal(made.echo(made.array), bare.echo(bare.array))


def test_a_target_of_which_nothing_is_seen_is_refused():
    behind = plate((-0.002, -0.002, 0.31), (0, 0.004, 0), (0.004, 0, 0), 4)
    inverted = joined(Body(SHEET.vertices_m, SHEET.faces[:, ::-1]), behind)
    for effect in (shadow_centre, shadow_antennas):
        with pytest.raises(HandbenchError, match="no facet"):
            np.asarray(state(inverted, effect).samples)


def test_lines_are_runs_of_neighbours():
    assert [len(line) for line in lines(qar50().tx_m)] == [47, 47]
    assert [len(line) for line in lines(np.zeros((1, 3)))] == [1]
    scattered = np.random.default_rng(0).uniform(size=(20, 3))
    assert sum(len(line) for line in lines(scattered)) == 20


def test_a_buffer_of_depths_sees_what_rays_see():
    facets = front_facets(scene(FINGERS), FINGERS)
    expected = by_rays(FINGERS, facets, np.zeros((1, 3)))[0]
    assert (
        visible_from(facets, np.zeros(3)) != expected
    ).mean() < 0.03  # cells of two facets at the shadow's edge


def test_an_estimate_casts_no_ray_and_sees_where_shadows_matter():
    before = Rays.cast
    fingers, sheet = scene(FINGERS), scene(SHEET)
    assert estimate_shadow_antennas(fingers).worst_mm > 1
    assert estimate_shadow_antennas(sheet).worst_mm < 0.02
    assert Rays.cast == before
