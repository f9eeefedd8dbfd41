"""Tables: ours beside the paper's in every format, strangers' names escaped."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace

import pytest

from handbench.bench.results.result_folder import Result, load
from handbench.reports.tables import blocks as parts
from handbench.reports.tables import latex
from handbench.reports.tables import result_tables as tables
from tests.reports.synthetic_result import compared

EVIL = '<b>50%_of$x & {y} \\ #^~|[z]"</b>'


@pytest.fixture(scope="module")
def result(result_folder):
    return load(result_folder)


@pytest.fixture(scope="module")
def evil(result):
    """The synthetic result with a stranger's method title and benchmark name."""
    methods = tuple(method.model_copy(update={"title": EVIL}) for method in result.about.methods)
    return replace(result, about=result.about.model_copy(update={"methods": methods, "name": EVIL}))


def cells(block: parts.Block, metric: str, source: str) -> tuple[str, ...]:
    (line,) = (line for line in block.lines if (line.metric, line.source) == (metric, source))
    return line.cells


def test_two_blocks_with_the_papers_figures_and_the_floor_directly_under_the_mae(result):
    blocks = parts.blocks(result)
    assert [block.reference for block in blocks] == ["photogrammetry", "truth"]
    for block in blocks:
        assert block.methods == ("2-FSK", "3-FSK", "Broadband", "Narrowband")
        assert cells(block, "mae_mm", "paper") == ("6.6", "1.7", "1.0", "13.4")
        assert cells(block, "precision_mm", "paper") == ("3.6", "0.3", "–", "–")
        lines = [(line.metric, line.source) for line in block.lines[:4]]
        assert lines == [
            ("mae_mm", "ours"),
            ("mae_mm", "paper"),
            ("mae_mm", "ours / paper"),
            ("floor_mm", "ours"),
        ]
        assert block.lines[3].title == "ground-truth floor (mm)"
    photogrammetry, truth = (cells(block, "floor_mm", "ours") for block in blocks)
    assert set(photogrammetry) == {"0.13"} and set(truth) == {"0"}


def judged(result: Result, p: float) -> Result:
    """broadband has the best MAE against the truth, 2-FSK and narrowband are worse with this p,
    3-FSK with 0.3."""
    figures = (1.0, 0.5, 1.5, "mm")
    lines = [
        ("mae_mm", "broadband", worse, *figures, chance, 2.0, "truth", 3, f"<b> {worse} |", "")
        for worse, chance in (("2fsk", p), ("3fsk", 0.3), ("narrowband", p))
    ]
    return compared(result, lines)


def test_only_what_a_test_stands_behind_stands_out(result):
    tested = judged(result, 1e-4)
    found = {
        (block.reference, line.metric): line.best
        for block in parts.blocks(tested)
        for line in block.lines
        if any(line.best)
    }
    assert found == {("truth", "mae_mm"): (False, True, True, False)}
    text, tex = tables.markdown(tested), latex.latex(tested)
    assert text.count("**") == 4 and "not shown to be worse" in text
    values = [result.row("mae_mm", method, "truth").value for method in ("3fsk", "broadband")]
    bold = [float(v) for v in re.findall(r"\\bfseries ([\d.]+)", tex)]
    assert bold == pytest.approx(values, abs=0.006)
    for other in (result, judged(result, 0.2)):
        assert "**" not in tables.markdown(other) and "Bold" not in tables.markdown(other)
        assert r"\bfseries" not in latex.latex(other)
    text = tables.comparisons_markdown(tested)
    assert "| &lt;b&gt; 2fsk \\| | truth | < 0.001 | 2.00 | 3 |" in text and "| 0.30 |" in text


def test_markdown_is_a_table_and_escapes(result, evil):
    text, escaped = tables.markdown(result), tables.markdown(evil)
    assert "| MAE (mm) | ours |" in text and "| paper | 6.6 | 1.7 | 1.0 | 13.4 |" in text
    lines = [line for line in escaped.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {7}
    assert "<b>" not in escaped


def test_csv_carries_ratio_and_time(result):
    lines = list(csv.DictReader(io.StringIO(tables.csv_text(result))))
    assert len(lines) == len(result.table) and all(line["seconds"] for line in lines)
    [line] = (
        line
        for line in lines
        if (line["metric"], line["method"], line["reference"]) == ("mae_mm", "3fsk", "truth")
    )
    assert float(line["ratio"]) == pytest.approx(float(line["value"]) / 1.7)
    assert float(line["seconds"]) == result.row("seconds", "3fsk", "truth").value


def test_terminal_table_prints_names_as_they_are(evil, monkeypatch, capsys):
    """rich would read [z] as markup; every headline metric and both blocks are there."""
    monkeypatch.delenv("COLUMNS", raising=False)  # pytest-xdist sets it
    tables.show(evil)
    text = capsys.readouterr().out
    assert "[z]" in text and text.count("MAE (mm)") == 2 and text.count("time per frame (s)") == 2
    assert text.count("ground-truth floor (mm)") == 2
    assert "RMSE" not in text


@pytest.mark.parametrize(
    ("value", "half", "unit", "text"),
    [
        (4.931, None, "mm", "4.9"),
        (1234.5, None, "s", "1234"),
        (-0.4, None, "mm", "−0.40"),
        (None, None, "mm", "–"),
        (0.8721, 0.49, "mm", "0.87 [0.38, 1.36]"),
        (43.36, 12.0, "s", "43 [31, 55]"),
        (1.2472, 0.05, "mm", "1.25 [1.20, 1.30]"),
        (97.347, None, "%", "97.3"),
    ],
)
def test_figures_have_two_digits_or_those_that_their_interval_is_worth(value, half, unit, text):
    ends = (None, None) if half is None else (value - half, value + half)
    assert parts.figure(value, *ends, unit) == text
