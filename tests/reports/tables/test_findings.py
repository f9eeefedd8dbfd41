"""Equal treatment in the report: its block, its figure and one sentence for each claim."""

from dataclasses import replace

import pandas as pd
import pytest

from handbench.bench import results
from handbench.bench.evaluation.tables import COMPARISONS, frame
from handbench.reports.tables.result_tables import findings, markdown
from tests.reports.synthetic_result import write_synthetic


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> results.Result:
    return results.load(
        write_synthetic(tmp_path_factory.mktemp("equal"), captures=("B", "F"), equal=True)
    )


def line(better: str, worse: str, metric: str, treatment: str, p: float | None) -> tuple:
    ends = (None, None) if p is None else (0.11, 0.29)
    return metric, better, worse, 0.2, *ends, "mm", p, 1.0, "photogrammetry", 2, 0, "", treatment


def with_comparisons(result: results.Result, lines: pd.DataFrame) -> results.Result:
    return replace(result, files={**result.files, "comparisons": lines})


def test_a_claim_is_one_sentence(result):
    lines = [
        line("broadband", "3fsk", "mae_mm", "none", 0.4),
        line("3fsk", "broadband", "mae_mm", "window", 0.001),
        line("3fsk", "broadband", "aurc_mm", "none", None),
        line("3fsk", "broadband", "mae_mm", "", 0.001),  # each as it is: says nothing of better
    ]
    [sentence] = findings(with_comparisons(result, frame(COMPARISONS, lines)))
    assert sentence == (
        "3-FSK and Broadband, on the pixels that all see: no difference shown unsmoothed (0.20 "
        "mm), 3-FSK better by 0.20 mm all averaged over 5 × 5 [0.11, 0.29]; over completeness: "
        "3-FSK ahead by 0.20 mm unsmoothed"
    )
    [few] = findings(with_comparisons(result, frame(COMPARISONS, lines[2:3])))
    assert few.endswith("(2 captures: too few for a test)")
    assert findings(with_comparisons(result, frame(COMPARISONS, lines[-1:]))) == []
    assert "## Under equal treatment against photogrammetry" in markdown(result)
    assert "| MAE on common pixels (mm) | unsmoothed |" in markdown(result)
