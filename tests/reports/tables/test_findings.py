"""Equal treatment in the report: its block, and what is said of each main pair."""

from handbench.bench.results.result_folder import load
from handbench.reports.tables.result_tables import claims, markdown
from tests.reports.synthetic_result import compared, write_synthetic


def line(better: str, worse: str, treatment: str, p: float | None) -> tuple:
    ends = (None, None) if p is None else (0.11, 0.29)
    return "mae_mm", better, worse, 0.2, *ends, "mm", p, 1.0, "photogrammetry", 2, "", treatment


def test_a_pair_is_compared_under_equal_treatment_only(tmp_path):
    result = load(write_synthetic(tmp_path / "r", captures=("B", "F"), equal=True))
    lines = [
        line("broadband", "3fsk", "none", 0.4),
        line("3fsk", "broadband", "window", 0.001),
        line("3fsk", "broadband", "", 0.001),  # each as it is: says nothing of better
    ]
    [(methods, at_common, few)] = claims(compared(result, lines))
    assert (methods, few) == ("3-FSK and Broadband", "")
    assert "0.20 mm" in at_common and "[0.11, 0.29]" in at_common
    assert claims(compared(result, lines[-1:])) == []
    [(_, _, few)] = claims(compared(result, [line("3fsk", "broadband", "none", None)]))
    assert few
    assert "| MAE on common pixels (mm) | unsmoothed |" in markdown(result)
