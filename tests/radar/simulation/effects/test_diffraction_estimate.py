"""The quick estimate of diffracted shadows against the effects themselves: nothing on convex
bodies, much where a finger stands before a plate."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.simulation.ablation import Ablation, worst_mm
from handbench.radar.simulation.catalogue import CONTAINED
from handbench.radar.simulation.effects.quick_estimate import CLEAR
from handbench.radar.simulation.effects.target_surface import estimate_shadow_diffraction
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from tests.radar.simulation.effects.closed_forms import sphere_body
from tests.radar.simulation.effects.plates import cylinder, dihedral, joined, plate
from tests.radar.simulation.effects.small_scenes import effect

FULL, TOLERANCE_MM = qar50(), 0.1
ARRAY = AntennaArray(FULL.tx_m[::3], FULL.rx_m[::3])
SHEET = plate((-0.03, -0.03, 0.30), (0, 0.06, 0), (0.06, 0, 0), 36)
BALL = sphere_body(0.02, 6, (0.0, 0.0, 0.32))
CONVEX = {"plate": SHEET, "sphere": BALL, "dihedral": dihedral(0.03, 0.06, (0, 0, 0.3), 30)}
TWO = joined(sphere_body(0.015, 5, (-0.02, 0.0, 0.32)), sphere_body(0.015, 5, (0.02, 0.0, 0.32)))
SHADED = joined(cylinder((0.0, 0.0, 0.27), 8e-3, 0.06, along=30), SHEET)


def scene(body):
    return EchoScene(ARRAY, np.array([79.5e9, 81.8e9, 82e9]), np.zeros(3), body)


def sizes_mm(body):
    """The size by a quick estimate, and that of the maps with sharp shadows instead."""
    estimate = estimate_shadow_diffraction(scene(body))
    shown = [effect(name) for name in ("obliquity", "shadow_antennas", "shadow_diffraction")]
    return estimate.worst_mm, worst_mm(
        Ablation(scene(body), shown, CONTAINED).change({"shadow_diffraction"})
    )


@pytest.mark.parametrize("name", CONVEX)
def test_nothing_is_seen_beside_outlines_of_what_hides_nothing(name):
    estimate_mm, change_mm = sizes_mm(CONVEX[name])
    assert CLEAR * estimate_mm < TOLERANCE_MM
    assert change_mm < 0.1 * TOLERANCE_MM
    rows = {row.effect: row for row in choose(scene(CONVEX[name]), "auto", TOLERANCE_MM)}
    assert not rows["shadow_diffraction"].on and "outlines" in rows["shadow_diffraction"].why


def test_a_finger_before_a_plate_is_diffracted():
    estimate_mm, change_mm = sizes_mm(SHADED)
    assert estimate_mm > CLEAR * TOLERANCE_MM
    assert change_mm / CLEAR < estimate_mm < CLEAR * change_mm
    assert {row.effect for row in choose(scene(SHADED), "auto", TOLERANCE_MM) if row.on} >= {
        "shadow_diffraction"
    }


def test_spheres_side_by_side_are_not_underestimated():
    """Each is beside the other's outline: in doubt, or on."""
    estimate_mm, change_mm = sizes_mm(TWO)
    assert change_mm < CLEAR * max(estimate_mm, TOLERANCE_MM / CLEAR)


def test_what_is_contained_is_looked_at_where_its_container_is_left_out():
    """Sharp shadows of each antenna take time, too: none are needed on a plate."""
    rows = {row.effect: row for row in choose(scene(SHEET), "auto", TOLERANCE_MM)}
    assert not rows["shadow_antennas"].on
    assert "depth buffers" in rows["shadow_antennas"].why
