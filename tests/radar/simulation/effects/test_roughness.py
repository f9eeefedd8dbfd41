"""Roughness and layer lines against closed forms: a sine's coherent loss, the field's statistics, a
moved plate."""

import numpy as np
import pytest
from scipy.special import j0

from handbench.radar.simulation.causes import Roughness
from handbench.radar.simulation.effects.target_surface import displace_facets, waves_of
from handbench.radar.simulation.physics.facets import facets_of
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from tests.radar.simulation.effects.plates import plate

K = 2 * np.pi * 80e9 / 299_792_458.0
SIDE_M = 6e-3


def flat(step_m: float, at_m: float = 0.0):
    return facets_of(plate((at_m, 0, 0), (0, SIDE_M, 0), (SIDE_M, 0, 0), round(SIDE_M / step_m)))


def echo(facets) -> complex:
    """What a plane wave along z finds again, over the plate's area: a closed form needs no
    antenna."""
    return complex(np.sum(facets.weight * np.exp(2j * K * facets.position_m[:, 2])) / SIDE_M**2)


@pytest.mark.parametrize(
    "step_m", [1e-3, 2e-5]
)  # finer than facets: weakened; resolved by them: displaced
def test_layer_lines_leave_a_mirror_what_bessels_function_says(step_m):
    """A sine of depth H leaves J₀(kH) of what a flat plate mirrors; exp(−k²H²/4) is its expansion
    to fourth order."""
    rough = Roughness(layer_depth_m=2e-4, layer_pitch_m=2e-4, layers_along=(1, 0, 0))
    lined = displace_facets(flat(step_m), *waves_of(rough, np.random.default_rng(1)), K)
    assert abs(echo(lined)) == pytest.approx(j0(K * 2e-4), abs=(K * 2e-4) ** 4 / 32)


@pytest.mark.parametrize("lag_m", [0.0, 0.5e-3, 1e-3, 2e-3])
def test_heights_have_their_spread_and_correlation(lag_m):
    """Over 40 surfaces of 36 patches, which know a variance to 3 %, at places a lag apart."""
    rough, products = Roughness(rms_m=1e-4, correlation_m=1e-3), []
    for seed in range(40):
        waves = waves_of(rough, np.random.default_rng(seed))
        here_m, there_m = (
            displace_facets(flat(1e-4, at_m), *waves, K).position_m[:, 2] for at_m in (0.0, lag_m)
        )
        products.append(here_m * there_m)
    expected = np.exp(-((lag_m / 1e-3) ** 2))
    assert np.mean(products) / 1e-8 == pytest.approx(expected, abs=0.15 if lag_m else 0.2)


def test_a_direction_has_a_length():
    with pytest.raises(
        HandbenchError, match=r"layers_along' is \[0, 0, 0\]; expected a direction of three numbers"
    ):
        parse(Roughness, {"layers_along": [0, 0, 0]}, "roughness")
