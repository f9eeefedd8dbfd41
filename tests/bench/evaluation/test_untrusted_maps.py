"""The numbers of a depth map are checked before it is scored."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.evaluation.score import score
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap
from tests.refusals import refuse

AXIS_M = np.linspace(-0.02, 0.02, 5)
Z_M = np.full((5, 5), 0.3)
PLAIN = DepthMap(AXIS_M, AXIS_M, Z_M, np.zeros((5, 5)), "mine")
REFERENCE = Reference(Z_M - 1e-3, np.zeros((5, 5)), None, None)


def one(value, of=Z_M):
    changed = of.copy()
    changed[2, 1] = value
    return changed


WRONG = {
    "infinite": ({"z_m": one(-np.inf)}, "z_m is -inf at 1 of 25"),
    "beyond float32": ({"z_m": one(1e39)}, "z_m is 1e+39 at 1 of 25"),
    "complex": ({"z_m": Z_M + 0j}, "z_m is complex128 (5, 5)"),
    "complex axis": ({"x_m": AXIS_M + 0j}, "x_m is complex128"),
    "NaN on the axis": ({"y_m": AXIS_M * np.array([1, 1, np.nan, 1, 1])}, "y_m"),
    "an axis twice": ({"x_m": np.zeros(5)}, "x_m"),
    "an axis out of order": ({"x_m": np.roll(AXIS_M, 2)}, "x_m"),
    "a huge axis": ({"x_m": AXIS_M * 1e300}, "x_m"),
    "amplitude of nothing": ({"amplitude_db": one(np.nan)}, "amplitude_db is nan at 1"),
    "negative sigma": ({"sigma_m": one(-1e-3)}, "sigma_m is -0.001 at 1"),
    "no probability": ({"p_gross": one(1.5)}, "p_gross is 1.5 at 1"),
}


@pytest.mark.parametrize(("changed", "place"), WRONG.values(), ids=WRONG)
def test_a_map_with_impossible_numbers_is_not_scored(changed, place):
    refuse(lambda: score(replace(PLAIN, **changed), REFERENCE), place)


@pytest.mark.parametrize("turned", [np.s_[::-1], np.s_[:]], ids=["descending", "ascending"])
def test_maps_with_nothing_at_some_pixels_are_scored(turned):
    depth = replace(PLAIN, x_m=AXIS_M[turned], z_m=one(np.nan), amplitude_db=one(np.nan, 0 * Z_M))
    assert score(depth, REFERENCE).figures["mae_mm"] == pytest.approx(1)
