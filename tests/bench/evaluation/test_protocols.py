"""Protocols: named, versioned, what they score and what they show."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.bench.evaluation.combine import PER_PIXEL, STRONGEST
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import METRICS, figures
from handbench.bench.evaluation.scoring_protocols import PROTOCOLS, main_table, protocol
from handbench.bench.evaluation.tables import SCORES, frame
from tests.refusals import refuse

AXIS_M = 2.5e-3 * np.arange(24)
PLATE_M = np.full((24, 24), 0.3)


def test_an_unknown_protocol_names_the_nearest():
    refuse(lambda: protocol("marron"), "'marron'", "maroon")


@pytest.mark.parametrize("chosen", PROTOCOLS.values(), ids=PROTOCOLS)
def test_the_table_holds_the_protocols_metrics(chosen):
    values = figures(error_map(AXIS_M, AXIS_M, PLATE_M + 1e-3, PLATE_M))
    values |= {key: 1.0 for key, m in METRICS.items() if m.of_velocities}
    lines = [("B", "3fsk", "truth", "", frame, *v) for v in values.items() for frame in range(2)]
    lines += [("P", "3fsk", "", "", n, STRONGEST, 0.3 + 1e-3 * n) for n in range(2)]
    lines += [("P", "3fsk", "", "", 0, PER_PIXEL, 1.0), ("B", "3fsk", "", "", 0, "seconds", 0.1)]
    scores = frame(SCORES, lines)
    plain, beside = (main_table(scores, chosen, 0, with_paper=paper) for paper in (False, True))
    values = plain.set_index("metric").value
    assert set(values.index) == set(chosen.metrics)
    assert values["mae_mm"] == pytest.approx(1, abs=1e-9)
    assert plain.paper.isna().all() and beside.set_index("metric").paper["mae_mm"] == 1.7
