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
from tests.radar.simulation.effects.plates import cylinder, dihedral, joined, plate
from tests.radar.simulation.effects.small_scenes import effect

FULL, TOLERANCE_MM = qar50(), 0.1
ARRAY = AntennaArray(FULL.tx_m[::3], FULL.rx_m[::3])
SHEET = plate((-0.03, -0.03, 0.30), (0, 0.06, 0), (0.06, 0, 0), 36)
DIHEDRAL = dihedral(0.03, 0.06, (0, 0, 0.3), 30)
SHADED = joined(cylinder((0.0, 0.0, 0.27), 8e-3, 0.06, along=30), SHEET)


def scene(body):
    return EchoScene(ARRAY, np.array([79.5e9, 81.8e9, 82e9]), np.zeros(3), body)


@pytest.mark.parametrize(("body", "diffracts"), [(SHEET, False), (DIHEDRAL, False), (SHADED, True)])
def test_an_estimate_is_small_for_bodies_that_hide_nothing_and_large_before_a_plate(
    body, diffracts
):
    estimate_mm = estimate_shadow_diffraction(scene(body)).worst_mm
    shown = [effect(name) for name in ("obliquity", "shadow_antennas", "shadow_diffraction")]
    change_mm = worst_mm(Ablation(scene(body), shown, CONTAINED).change({"shadow_diffraction"}))
    if diffracts:
        assert estimate_mm > CLEAR * TOLERANCE_MM
        assert change_mm / CLEAR < estimate_mm < CLEAR * change_mm
    else:
        assert CLEAR * estimate_mm < TOLERANCE_MM and change_mm < 0.1 * TOLERANCE_MM
    rows = {row.effect: row for row in choose(scene(body), "auto", TOLERANCE_MM)}
    assert rows["shadow_diffraction"].on == diffracts
    assert diffracts or "outlines" in rows["shadow_diffraction"].why
