"""Tables: ours beside the paper's in every format, strangers' names escaped."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from handbench.bench.results.result_folder import Result, load
from handbench.cli.run import show
from handbench.reports.tables import table as tables
from handbench.reports.tables.rounding import figure
from handbench.reports.tables.writers import html, latex, markdown
from tests.reports.synthetic_result import compared, write_synthetic

EVIL = '<b>50%_of$x & {y} \\ #^~|[z]"</b>'


@pytest.fixture(scope="module")
def result(result_folder):
    return load(result_folder)


@pytest.fixture(scope="module")
def evil(result):
    """The synthetic result with a stranger's method title and benchmark name."""
    methods = tuple(method.model_copy(update={"title": EVIL}) for method in result.about.methods)
    return replace(result, about=result.about.model_copy(update={"methods": methods, "name": EVIL}))


def test_every_reference_has_a_table_with_the_papers_figures_and_the_floor(result):
    every = tables.every_figure(result)
    assert [table.caption for table in every] == [
        tables.AGAINST[reference].capitalize() for reference in ("photogrammetry", "truth")
    ]
    for table, floor in zip(every, ("0.13", "0"), strict=True):
        texts = table.texts
        assert texts.index[:2].tolist() == ["MAE (mm)", "ground-truth floor (mm)"]
        for title, paper in (("MAE (mm)", ("6.6", "1.7", "1.0", "13.4")),):
            lines = [cell.split("\n") for cell in texts.loc[title]]
            assert tuple(line[2] for line in lines) == tuple(f"paper {of}" for of in paper)
        assert set(texts.loc["ground-truth floor (mm)"]) == {floor}


def test_the_papers_table_has_its_metrics_and_methods_only(result):
    texts = tables.of_paper(result).texts
    assert texts.index.tolist() == ["MAE (mm)", "MAX of AE (mm)", "precision (mm)"]
    assert texts.columns.tolist() == ["2-FSK", "3-FSK", "Broadband", "Narrowband"]
    assert texts.loc["MAE (mm)"].str.endswith((" (6.6)", " (1.7)", " (1.0)", " (13.4)")).all()
    without = replace(result, table=result.table.assign(paper=float("nan")))
    assert tables.of_paper(without) is None


def judged(result: Result, p: float) -> Result:
    """broadband has the best MAE against the truth, 2-FSK and narrowband are worse with this p,
    3-FSK with 0.3."""
    figures = (1.0, 0.5, 1.5, "mm")
    lines = [
        ("mae_mm", "broadband", worse, *figures, chance, 2.0, "truth", 3, f"<b> {worse} |", "")
        for worse, chance in (("2fsk", p), ("3fsk", 0.3), ("narrowband", p))
    ]
    return compared(result, lines)


def test_only_what_a_test_stands_behind_is_highlighted(result):
    tested = judged(result, 1e-4)
    lines = result.table[(result.table.reference == "truth") & (result.table.metric != "bias_mm")]
    table = tables.figures(tested, lines)
    stars = table.texts.map(lambda text: text.startswith("★"))
    assert stars["MAE (mm)"].tolist() == [False, True, True, False]
    assert stars.to_numpy().sum() == 2
    others = tables.figures(judged(result, 0.2), lines)
    for writer, mark in ((markdown, "★"), (latex, r"$\star$"), (html, "★")):
        assert (writer(table).count(mark), writer(others).count(mark)) == (2, 0)
    text = markdown(tables.differences(tested))
    assert "| &lt;b&gt; 2fsk \\| | truth | &lt; 0.001 | 2.00 |" in text and "| 0.30 |" in text


def test_the_main_pairs_are_compared_under_equal_treatment_only(tmp_path):
    result = load(write_synthetic(tmp_path / "r", captures=("B", "F"), equal=True))
    lines = [
        ("mae_mm", *pair, 0.2, 0.11, 0.29, "mm", 0.4, 1.0, "truth", 2, sentence, treatment)
        for pair, sentence, treatment in (
            (("broadband", "3fsk"), "no difference", "none"),
            (("3fsk", "broadband"), "3-FSK is better", "window"),
            (("3fsk", "broadband"), "each as it is", ""),
            (("narrowband", "2fsk"), "no main pair", "none"),
        )
    ]
    tested = compared(result, lines)
    assert tables.differences(tested, main=True).texts.index.tolist() == [
        "no difference",
        "3-FSK is better",
    ]
    assert len(tables.differences(tested).texts) == 4
    assert "MAE on common pixels, unsmoothed (mm)" in tables.every_figure(result)[-1].texts.index


def test_markdown_and_html_escape(evil):
    for table in tables.every_figure(evil):
        lines = [line for line in markdown(table).splitlines() if line.startswith("|")]
        assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {6}
        assert "<b>" not in markdown(table) and "<b>50" not in html(table)


def test_a_run_ends_with_the_papers_table_and_ours(tmp_path, monkeypatch, capsys):
    """rich would read [z] as markup."""
    monkeypatch.setenv("COLUMNS", "80")
    methods = {"3fsk": ("3-FSK", 1.5, 0.2), "joint": ("joint [z]", 0.5, 0.4)}
    result = load(write_synthetic(tmp_path / "r", ("B",), methods, step_m=6e-3))
    show(result, tmp_path)
    paper, ours, end = capsys.readouterr().out.split("\n\n")
    assert "joint" not in paper and "(1.7)" in paper
    assert "joint [z]" in ours and "3-FSK" not in ours
    assert "ground-truth floor 0.13 mm; observed" in end and "table.csv" in end


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
    assert figure(value, *ends, unit) == text
