"""The main table of a result, a function of its scores: each figure with its interval, its unit and
the value of the paper."""

from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.combine import MethodScores
from handbench.bench.evaluation.metrics import METRICS
from handbench.bench.evaluation.scoring_protocols import REFERENCES, Protocol
from handbench.bench.evaluation.tables import TABLE, frame


def main_table(
    scores: pd.DataFrame, protocol: Protocol, seed: int, with_paper: bool
) -> pd.DataFrame:
    """Compute the main table (TABLE) from the table of scores (SCORES): the figures of each method,
    for one reference after the other.
    scores: only the captures and methods of the table, in their order. protocol: which metrics are
    shown. seed: of bootstrap intervals. with_paper: False leaves the column `paper` empty."""
    rows: list[tuple[object, ...]] = []
    own = scores[scores.treatment == ""]
    for reference in REFERENCES:
        lines = own[own.reference.isin((reference, ""))]
        captures: dict[Any, np.ndarray] = lines.groupby("metric").capture.unique().to_dict()
        for method in lines.method[lines.reference == reference].unique():
            of_method: dict[Any, pd.DataFrame] = dict(
                iter(lines[lines.method == method].groupby("metric"))
            )
            method_scores = MethodScores(of_method, captures, seed)
            for metric in (m for m in METRICS.values() if m.key in protocol.metrics):
                figure = metric.combine(metric, method_scores)
                if figure is not None:
                    value, interval = figure
                    paper = metric.paper.get(method) if with_paper else None
                    ends = interval or (None, None)
                    rows.append((metric.key, method, value, *ends, metric.unit, paper, reference))
    return frame(TABLE, rows)
