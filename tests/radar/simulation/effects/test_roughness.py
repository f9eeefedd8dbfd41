"""Roughness and layer lines against closed forms."""

import numpy as np
import pytest
from scipy.special import j0

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.effects.surfaces import displace_facets, waves_of
from handbench.radar.simulation.scene import Roughness
from handbench.radar.simulation.scene_echoes import facets_of
from handbench.support.config import parse
from tests.radar.simulation.effects.plates import plate
from tests.refusals import refuse

K = 2 * np.pi * 80e9 / SPEED_OF_LIGHT_M_S
SIDE_M = 6e-3


def rough_facets(rough: Roughness, seed: int, step_m: float, at_m: float = 0.0):
    """The facets of a rough plate whose edge is at x = at_m."""
    flat = plate((at_m, 0, 0), (0, SIDE_M, 0), (SIDE_M, 0, 0), round(SIDE_M / step_m))
    return displace_facets(facets_of(flat), *waves_of(rough, np.random.default_rng(seed)), K)


# finer than facets: weakened; resolved by them: displaced
@pytest.mark.parametrize("step_m", [1e-3, 2e-5])
def test_layer_lines_leave_a_mirror_what_bessels_function_says(step_m):
    """A sine of depth H leaves J₀(kH) of what a flat plate mirrors to a plane wave along z;
    exp(−k²H²/4) is its expansion to fourth order."""
    rough = Roughness(layer_depth_m=2e-4, layer_pitch_m=2e-4, layers_along=(1, 0, 0))
    lined = rough_facets(rough, 1, step_m)
    echo = np.sum(lined.weight * np.exp(2j * K * lined.position_m[:, 2])) / SIDE_M**2
    assert abs(echo) == pytest.approx(j0(K * 2e-4), abs=(K * 2e-4) ** 4 / 32)


@pytest.mark.parametrize("lag_m", [0.0, 0.5e-3, 1e-3, 2e-3])
def test_heights_have_their_spread_and_correlation(lag_m):
    """Over 40 surfaces of 36 patches, which know a variance to 3 %, at places a lag apart."""
    rough, products = Roughness(rms_m=1e-4, correlation_m=1e-3), []
    for seed in range(40):
        here, there = (rough_facets(rough, seed, 2e-4, at_m) for at_m in (0.0, lag_m))
        products.append(here.position_m[:, 2] * there.position_m[:, 2])
    expected = np.exp(-((lag_m / 1e-3) ** 2))
    assert np.mean(products) / 1e-8 == pytest.approx(expected, abs=0.15 if lag_m else 0.2)


def test_a_direction_has_a_length():
    values = {"layers_along": [0, 0, 0]}
    refuse(lambda: parse(Roughness, values, "roughness"), "roughness", "layers_along", "[0, 0, 0]")
