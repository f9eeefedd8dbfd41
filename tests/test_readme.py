"""The tables of README and docs/results.md: written from a result, and compared with one."""

from __future__ import annotations

from dataclasses import replace

from docs import readme
from handbench.bench.results.result_folder import load
from tests.golden_files import RESULT


def test_written_tables_agree_with_their_result_and_differ_from_another(tmp_path):
    """1.2 µm of 1.20 mm are not printed, and times are the machine's."""
    result = load(RESULT)
    (tmp_path / "docs").mkdir()
    for page in readme.PAGES:
        text = "before\n<!-- table: begin -->\nstale\n<!-- table: end -->\nafter\n"
        (tmp_path / page).write_text(text, "utf-8")
    readme.write(result, tmp_path)
    text = (tmp_path / "README.md").read_text("utf-8")
    assert text.startswith("before\n<!--") and text.endswith("-->\nafter\n")
    assert "| MAE (mm) | 4.5 *6.6* | 1.2 *1.7* | 0.67 *1.0* | – |" in text
    assert (tmp_path / "docs" / "depth_F.png").read_bytes().startswith(b"\x89PNG")
    assert list(readme.differences(result, tmp_path)) == []
    for metric, factor, count in (("mae_mm", 1.001, 0), ("seconds", 3.0, 0), ("mae_mm", 1.1, 1)):
        table = result.table.copy()
        table.loc[(table.metric == metric) & (table.method == "3fsk"), "value"] *= factor
        assert len(list(readme.differences(replace(result, table=table), tmp_path))) == count
