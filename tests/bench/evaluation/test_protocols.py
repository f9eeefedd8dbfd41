"""Protocols: named, versioned, what they score and what they show."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import VELOCITY, of_captures, over_frames
from handbench.bench.evaluation.rows import accuracy_rows, frame_rows, precision_rows, time_rows
from handbench.bench.evaluation.scoring_protocols import PROTOCOLS, protocol
from handbench.support.errors import HandbenchError

AXIS_M = 2.5e-3 * np.arange(24)
PLATE_M = np.full((24, 24), 0.3)


def test_an_unknown_protocol_names_the_nearest():
    with pytest.raises(HandbenchError, match="maroon"):
        protocol("marron")


@pytest.mark.parametrize("chosen", PROTOCOLS.values(), ids=PROTOCOLS)
def test_the_table_holds_the_protocols_metrics(chosen):
    m = error_map(AXIS_M, AXIS_M, PLATE_M + 1e-3, PLATE_M)
    velocities = dict.fromkeys(VELOCITY, 1.0)
    rows = [
        accuracy_rows("3fsk", "truth", of_captures([m]).assign(**velocities), chosen),
        time_rows("3fsk", "truth", [0.1]),
    ]
    rows.append(frame_rows("3fsk", "truth", [over_frames(np.ones(2), np.ones(2))], chosen))
    if "precision_mm" in chosen.metrics:
        rows.append(precision_rows("3fsk", "truth", [np.array([0.3, 0.301])], [1.0]))
    values = pd.concat(rows).set_index("metric").value
    assert set(values.index) == set(chosen.metrics)
    assert values["mae_mm"] == pytest.approx(1, abs=1e-9)
