"""Protocols: named, versioned, what they score and what they show."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import AVERAGED, METRICS, of_captures, over_frames
from handbench.bench.evaluation.metrics import PAPER as PAPER_FIGURES
from handbench.bench.evaluation.rows import accuracy_rows, frame_rows, precision_rows, time_rows
from handbench.bench.evaluation.scoring_protocols import PAPER, PROTOCOLS, protocol
from handbench.support.errors import HandbenchError

AXIS_M = 2.5e-3 * np.arange(24)
PLATE_M = np.full((24, 24), 0.3)


@pytest.mark.parametrize("chosen", PROTOCOLS.values(), ids=PROTOCOLS)
def test_says_what_it_is_and_knows_its_metrics(chosen):
    about = json.loads(json.dumps(chosen.about()))
    assert about["id"] == chosen.id and about["version"] == chosen.version >= 1
    assert {"accuracy", "mask", "reference", "metrics", "compared", "frame"} <= set(about)
    assert set(chosen.metrics) <= set(METRICS)
    assert set(chosen.compared) <= set(AVERAGED) & set(chosen.metrics)
    assert protocol(chosen.id) is chosen


def test_an_unknown_protocol_names_the_nearest():
    with pytest.raises(HandbenchError, match="maroon"):
        protocol("marron")


def test_the_papers_table_has_the_papers_figures():
    assert {metric for metric, _ in PAPER_FIGURES} <= set(PAPER.metrics)
    shown = {
        "mae_mm",
        "floor_mm",
        "max_mm",
        "rmse_mm",
        "median_mm",
        "p95_mm",
        "bias_mm",
        "relative_accuracy_percent",
        "observed_percent",
        "n_observed",
        "precision_mm",
        "relative_precision_percent",
        "seconds",
    }
    assert shown <= set(PAPER.metrics)


@pytest.mark.parametrize("chosen", PROTOCOLS.values(), ids=PROTOCOLS)
def test_the_table_holds_the_protocols_metrics(chosen):
    m = error_map(AXIS_M, AXIS_M, PLATE_M + 1e-3, PLATE_M)
    rows = [
        accuracy_rows("3fsk", "truth", of_captures([m]), chosen),
        time_rows("3fsk", "truth", [0.1]),
    ]
    rows.append(frame_rows("3fsk", "truth", [over_frames(np.ones(2), np.ones(2))], chosen))
    if "precision_mm" in chosen.metrics:
        rows.append(precision_rows("3fsk", "truth", [np.array([0.3, 0.301])], [1.0]))
    values = pd.concat(rows).set_index("metric").value
    assert set(values.index) == set(chosen.metrics)
    assert values["mae_mm"] == pytest.approx(1, abs=1e-9)
