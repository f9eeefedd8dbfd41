"""The flag of a plane that lies a period away: exact echoes of four fingers, and targets that are
there."""

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import TwoToneConfig
from tests.references.exact.cases import ALONG, SCENES, Case, exact_echoes

TONES_HZ = np.array([82.0e9, 81.8e9])


def test_four_fingers_are_not_taken_for_a_far_target():
    """The plane a period behind has a peak 1.2 to 1.3 times as high: its wide cells gather the four
    highlights."""
    samples = exact_echoes(
        Case("four fingers", SCENES["four fingers"], "metal", ALONG), TONES_HZ, qar50()
    )
    depth = fsk_with_uncertainty(
        RadarCapture(samples[None].astype(np.complex64), TONES_HZ, qar50()), TwoToneConfig()
    )
    assert np.isfinite(depth.z_m).sum() > 4000 and not depth.wrapped.any()


@pytest.mark.parametrize("count", [1, 5, 400])
def test_a_target_that_is_there_is_still_flagged(count):
    """Point scatterers and a speckled one at 1.05 m, which a first depth of 0.3 m takes for 0.3
    m."""
    draws, array = np.random.default_rng(count), qar50()
    at_m = np.column_stack(
        [draws.uniform(-0.06, 0.06, (count, 2)), 1.05 + draws.uniform(-0.003, 0.003, count)]
    )
    strength = draws.standard_normal(count) + 1j * draws.standard_normal(count)
    samples = []
    for f in TONES_HZ:
        out, back = (
            np.exp(
                -2j
                * np.pi
                * f
                / SPEED_OF_LIGHT_M_S
                * np.linalg.norm(at_m[:, None] - antennas_m, axis=2)
            )
            for antennas_m in (array.tx_m, array.rx_m)
        )
        samples.append((out * strength[:, None]).T @ back)
    depth = fsk_with_uncertainty(
        RadarCapture(np.array(samples)[None].astype(np.complex64), TONES_HZ, array),
        TwoToneConfig(first_depth_m=0.3),
    )
    assert depth.wrapped.all()
