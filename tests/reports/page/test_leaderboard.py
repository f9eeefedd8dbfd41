"""The report of several results: one table, and the report of each."""

import shutil

import pandas as pd
import pytest

from handbench.cli.main import main
from handbench.reports.page import html, rendering


@pytest.mark.slow
def test_several_results_are_one_ranking_with_their_reports(
    small_result, tmp_path, capsys, monkeypatch
):
    """Of the pictures those of the causes alone, which nothing else draws, and as PNG only."""
    monkeypatch.setattr(html, "panels", lambda *_: ())
    monkeypatch.setattr(html.plots, "overview", lambda *_: ())
    images = rendering.images
    monkeypatch.setattr(rendering, "images", lambda draw, folder, _=0: images(draw, folder, False))
    shutil.copytree(small_result, tmp_path / "A", ignore=shutil.ignore_patterns("work"))
    shutil.copytree(small_result, tmp_path / "B <b>", ignore=shutil.ignore_patterns("work"))
    scores = pd.read_csv(tmp_path / "B <b>" / "scores.csv", keep_default_na=False)
    right = (
        (scores.metric == "complete_2mm_percent")
        & (scores.method == "2fsk")
        & (scores.treatment == "")
    )
    scores.loc[right, "value"] = 99.5
    scores.to_csv(tmp_path / "B <b>" / "scores.csv", index=False)
    results = [str(tmp_path / "A"), str(tmp_path / "B <b>")]
    assert main(["report", *results, "-o", str(tmp_path / "out")]) == 0
    table = pd.read_csv(tmp_path / "out" / "leaderboard.csv")
    assert len(table) == 4 and table.complete_2mm_percent.is_monotonic_decreasing
    assert (table.method[0], table.result[0]) == (
        "2-FSK",
        results[1],
    ) and table.complete_2mm_percent[0] == 99.5
    text = (tmp_path / "out" / "leaderboard.md").read_text()
    assert "too few captures to test" in text and "<b>" not in text
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'href="report-1/index.html"' in page and "B <b>" not in page
    assert 'id="causes"' in (tmp_path / "out/report-2/index.html").read_text("utf-8")
    assert (tmp_path / "out/report-2/figures/causes__truth.png").is_file()
    assert main(["report", *results, "-o", str(tmp_path / "out"), "--tradeoff", results[0]]) == 2
    assert "works with one result folder only" in capsys.readouterr().err
