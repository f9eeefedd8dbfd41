"""The flag of a plane that lies a period away, which exact echoes of four fingers do not raise."""

import numpy as np
import pytest

from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.registry import PAIR_HZ
from tests.references.exact.cases import SCENES, exact_echoes

TONES_HZ = np.array(PAIR_HZ)


@pytest.mark.slow
def test_four_fingers_are_not_taken_for_a_far_target():
    """The plane a period behind has a peak 1.2 to 1.3 times as high: its wide cells gather the four
    highlights."""
    samples = exact_echoes(SCENES["four fingers"], "metal", TONES_HZ, qar50())
    capture = RadarCapture(samples[None].astype(np.complex64), TONES_HZ, qar50())
    depth = fsk_with_uncertainty(capture, Fsk(tones_hz=PAIR_HZ, filter_px=1))
    assert np.isfinite(depth.z_m).sum() > 4000 and not depth.wrapped.any()
