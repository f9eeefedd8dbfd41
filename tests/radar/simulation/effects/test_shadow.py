"""Shadows against the formula: rays from every antenna to every facet."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.effects.target_surface import (
    obliquity,
    shadow_antennas,
    shadow_centre,
)
from handbench.radar.simulation.physics import facets as splitting
from handbench.radar.simulation.physics.facets import face_vectors
from handbench.radar.simulation.physics.line_of_sight import facets_in_sight, rays_of
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, front_facets
from handbench.support.errors import HandbenchError
from handbench.support.rays import Rays
from tests.radar.simulation.effects.plates import cylinder, joined, plate, sphere_body
from tests.radar.simulation.effects.small_scenes import TONES_HZ, shaped

FINGERS = joined(cylinder((0.0, 0.0, 0.30), 8e-3, 0.05), cylinder((0.014, 0.0, 0.33), 8e-3, 0.05))
SHEET = plate((-0.04, -0.03, 0.3), (0, 0.06, 0), (0.08, 0, 0), 40)  # its front is towards the array


def scene(body: Body, array: AntennaArray | None = None) -> EchoScene:
    return EchoScene(array or qar50(), TONES_HZ, np.zeros(3), body)


def state(body: Body, *effects) -> Echoes:
    return shaped(scene(body), obliquity, *effects)


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


def test_shadows_from_the_centre_keep_what_it_sees():
    made = state(FINGERS, shadow_centre)
    facets = front_facets(made.scene, FINGERS)
    expected = by_rays(FINGERS, facets, np.zeros((1, 3)))[0]
    assert np.array_equal(made.surface.facets.position_m, facets.position_m[expected])
    assert made.surface.seen is None


def test_a_target_of_which_nothing_is_seen_is_refused():
    behind = plate((-0.002, -0.002, 0.31), (0, 0.004, 0), (0.004, 0, 0), 4)
    inverted = joined(Body(SHEET.vertices_m, SHEET.faces[:, ::-1]), behind)
    for effect in (shadow_centre, shadow_antennas):
        with pytest.raises(HandbenchError, match="no facet"):
            state(inverted, effect).samples()


@pytest.mark.parametrize("away", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_facet_counts_when_only_one_side_of_the_aperture_sees_it(away):
    """A facet whose plane meets the aperture 0.05 m off its centre: antennas on either side see one
    of its faces."""
    place_m, towards = np.array([0.0, 0.0, 0.3]), np.array([*away, 0.0])
    along = place_m - 0.05 * towards  # away from where the plane meets the aperture
    across = np.cross(along, towards)
    for side in (1, -1):
        body = plate(place_m, 1e-3 * side * across, 1e-3 * along, 1)
        assert len(front_facets(EchoScene(qar50(), TONES_HZ, np.zeros(3), body), body)) > 0


def test_a_mesh_that_would_become_too_many_facets_is_refused(monkeypatch):
    """Edges of 42 mm split to 1.4 mm make 4⁵ facets of each of the two triangles."""
    made = plate((0.0, 0.0, 0.3), (0.03, 0, 0), (0, 0.03, 0), 1)
    monkeypatch.setattr(splitting, "MOST_FACETS", 2 * 4**5)
    assert len(splitting.facets_of(made, 1.4e-3)) == 2 * 4**5
    monkeypatch.setattr(splitting, "MOST_FACETS", 2 * 4**5 - 1)
    with pytest.raises(HandbenchError, match="more than 2047 facets; remesh"):
        splitting.facets_of(made, 1.4e-3)
