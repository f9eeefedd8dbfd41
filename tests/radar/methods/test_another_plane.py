"""The flag of a plane that lies a period away: exact echoes of four fingers, and targets that are
there."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import TwoToneConfig
from tests.radar.simulated_points import exact_capture
from tests.references.exact.cases import ALONG, SCENES, Case, exact_echoes

TONES_HZ = np.array([82.0e9, 81.8e9])


@pytest.mark.slow
def test_four_fingers_are_not_taken_for_a_far_target():
    """The plane a period behind has a peak 1.2 to 1.3 times as high: its wide cells gather the four
    highlights."""
    case = Case("four fingers", SCENES["four fingers"], "metal", ALONG)
    samples = exact_echoes(case, TONES_HZ, qar50())[None].astype(np.complex64)
    depth = fsk_with_uncertainty(RadarCapture(samples, TONES_HZ, qar50()), TwoToneConfig())
    assert np.isfinite(depth.z_m).sum() > 4000 and not depth.wrapped.any()


@pytest.mark.parametrize("count", [1, 400])
def test_a_target_that_is_there_is_still_flagged(count):
    """A point scatterer and a speckled one at 1.05 m, which a first depth of 0.3 m takes for 0.3
    m."""
    draws = np.random.default_rng(count)
    x_m, y_m = draws.uniform(-0.06, 0.06, (2, count))
    at_m = np.stack([x_m, y_m, 1.05 + draws.uniform(-0.003, 0.003, count)], axis=1)
    capture = exact_capture(at_m, TONES_HZ, draws.standard_normal((count, 2)) @ [1, 1j])
    depth = fsk_with_uncertainty(capture, TwoToneConfig(first_depth_m=0.3))
    assert depth.wrapped.all()
