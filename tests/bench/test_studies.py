"""The study of fast imaging and simulation runs."""

import numpy as np
import pytest

from handbench.bench import studies
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.grid import Axis
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.radar.simulation.forward import Scatterers


@pytest.mark.slow
def test_fast_sums_are_within_their_tolerance_of_exact_ones():
    """On a small volume, with few antennas and scatterers."""
    few = np.random.default_rng(0).uniform(-0.01, 0.01, (60, 3)) + [0, 0, 0.29]
    side, depth = (Axis(start_m=a, stop_m=b, step_m=2e-3) for a, b in ((-0.02, 0.02), (0.28, 0.3)))
    volume = Backprojection(x=side, y=side, z=depth, tones_hz={"count": 16})
    array = AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])
    frame = Fsk(x=side, y=side)
    cases = studies.cases(Scatterers(few, np.ones(60)), array, volume, frame)
    rows = [studies.measure(case, repeats=1) for case in cases]
    assert len(rows) == 3 and all(row["relative_error"] < studies.TOLERANCE for row in rows)
    assert all(row["ratio_to_exact"] > 0 for row in rows)
