"""The facets of a surface: which face the array, and how many."""

import numpy as np
import pytest

from handbench.radar.simulation import scene_echoes as splitting
from handbench.radar.simulation.effects.surfaces import obliquity, shadow
from handbench.radar.simulation.scene_echoes import front_facets
from tests.radar.simulation.effects.plates import joined, plate
from tests.radar.simulation.effects.small_scenes import bead_scene, shaped
from tests.refusals import refuse


def test_a_target_of_which_nothing_is_seen_is_refused():
    """A sheet of which the back is towards the array, and a plate behind it."""
    sheet = plate((-0.04, -0.03, 0.3), (0.08, 0, 0), (0, 0.06, 0), 40)
    behind = plate((-0.002, -0.002, 0.31), (0, 0.004, 0), (0.004, 0, 0), 4)
    made = shaped(bead_scene(target=joined(sheet, behind)), obliquity, shadow)
    refuse(made.samples, "target: ")


@pytest.mark.parametrize("away", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_facet_counts_when_only_one_side_of_the_aperture_sees_it(away):
    """A facet whose plane meets the aperture 0.05 m off its centre: antennas on either side see one
    of its faces."""
    place_m, towards = np.array([0.0, 0.0, 0.3]), np.array([*away, 0.0])
    along = place_m - 0.05 * towards  # away from where the plane meets the aperture
    for side in (1, -1):
        body = plate(place_m, 1e-3 * side * np.cross(along, towards), 1e-3 * along, 1)
        assert len(front_facets(bead_scene(target=body), body)) > 0


def test_a_mesh_that_would_become_too_many_facets_is_refused(monkeypatch):
    """Edges of 42 mm split to 1.4 mm make 4⁵ facets of each of the two triangles."""
    made = plate((0.0, 0.0, 0.3), (0.03, 0, 0), (0, 0.03, 0), 1)
    monkeypatch.setattr(splitting, "MOST_FACETS", 2 * 4**5)
    assert len(splitting.facets_of(made, 1.4e-3)) == 2 * 4**5
    monkeypatch.setattr(splitting, "MOST_FACETS", 2 * 4**5 - 1)
    refuse(lambda: splitting.facets_of(made, 1.4e-3), "2047 facets")
