"""The tables of README and docs/results.md: written from a result, and compared with one."""

from __future__ import annotations

from dataclasses import replace

from docs import readme
from handbench.bench.results.result_folder import load
from handbench.reports.figures.style import STYLE
from tests.golden_files import RESULT


def test_written_tables_agree_with_their_result_and_differ_from_another(tmp_path, monkeypatch):
    """1.2 µm of 1.20 mm are not printed, times are the machine's, and one pixel decides a MAX."""
    monkeypatch.setitem(STYLE, "savefig.dpi", 50)  # for speed
    result = load(RESULT)
    (tmp_path / "docs").mkdir()
    for page, name in readme.PAGES:
        with (tmp_path / page).open("a", encoding="utf-8") as file:
            file.write(f"before\n<!-- {name}: begin -->\nstale\n<!-- {name}: end -->\nafter\n")
    readme.write(result, tmp_path)
    text = (tmp_path / "README.md").read_text("utf-8")
    assert text.startswith("before\n<!--") and text.endswith("-->\nafter\n")
    assert "| MAE (mm) | 4.5 *6.6* | 1.2 *1.7* | 0.67 *1.0* | – |" in text
    assert (tmp_path / "docs" / "depth_F.png").read_bytes().startswith(b"\x89PNG")
    table = result.table.set_index(["metric", "method"])
    for mae, others, count in ((1.001, 3.0, 0), (1.1, 1.0, 1)):
        ours = table.copy()
        ours.loc[("mae_mm", "3fsk"), "value"] *= mae
        ours.loc[[("seconds", "3fsk"), ("max_mm", "3fsk")], "value"] *= others
        changed = replace(result, table=ours.reset_index())
        assert len(list(readme.differences(changed, tmp_path))) == count
