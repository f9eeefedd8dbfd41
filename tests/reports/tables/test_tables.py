"""Tables: ours beside the paper's in every format, strangers' names escaped."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handbench.bench import results
from handbench.bench.evaluation.tables import COMPARISONS, TASKS, frame
from handbench.bench.results import Section, Setting, Tradeoff, TradeoffFacts
from handbench.reports.tables import blocks as parts
from handbench.reports.tables import latex
from handbench.reports.tables import result_tables as tables
from tests.reports.synthetic_result import METHODS, write_synthetic

EVIL = '<b>50%_of$x & {y} \\ #^~|[z]"</b>'


@pytest.fixture(scope="module")
def result(result_folder):
    return results.load(result_folder)


@pytest.fixture(scope="module")
def evil(result):
    """The synthetic result with a stranger's method title and benchmark name."""
    methods = tuple(method.model_copy(update={"title": EVIL}) for method in result.about.methods)
    return replace(result, about=result.about.model_copy(update={"methods": methods, "name": EVIL}))


def cells(block: parts.Block, metric: str, source: str) -> tuple[str, ...]:
    (line,) = (line for line in block.lines if (line.metric, line.source) == (metric, source))
    return line.cells


def test_two_blocks_with_the_papers_figures(result):
    blocks = parts.blocks(result)
    assert [block.reference for block in blocks] == ["photogrammetry", "truth"]
    for block in blocks:
        assert block.methods == ("2-FSK", "3-FSK", "Broadband", "Narrowband")
        assert cells(block, "mae_mm", "paper") == ("6.6", "1.7", "1.0", "13.4")
        assert cells(block, "max_mm", "paper") == ("39.2", "28.8", "32.0", "64.9")
        assert cells(block, "precision_mm", "paper") == ("3.6", "0.3", "–", "–")


def test_ours_ratio_and_time_are_the_results(result):
    row = result.row("mae_mm", "2fsk", "truth")
    block = parts.blocks(result)[1]
    ours = cells(block, "mae_mm", "ours")[0]
    assert [float(number) for number in re.findall(r"[\d.]+", ours)] == pytest.approx(
        [row.value, row.low, row.high], abs=0.006
    )
    assert float(cells(block, "mae_mm", "ours / paper")[0]) == pytest.approx(
        row.value / 6.6, abs=0.006
    )
    assert all(cell != "–" for cell in cells(block, "seconds", "ours"))


def test_the_floor_stands_directly_under_the_mae(result):
    """Against photogrammetry it is √(2/π)·√(0.05² + 0.15²) = 0.126 mm for every method; the truth
    has none."""
    for block in parts.blocks(result):
        lines = [(line.metric, line.source) for line in block.lines[:4]]
        assert lines == [
            ("mae_mm", "ours"),
            ("mae_mm", "paper"),
            ("mae_mm", "ours / paper"),
            ("floor_mm", "ours"),
        ]
        assert block.lines[3].title == "ground-truth floor (mm)"
    photogrammetry, truth = (cells(block, "floor_mm", "ours") for block in parts.blocks(result))
    assert all(re.fullmatch(r"0\.13 \[0\.0\d, 0\.\d\d\]", cell) for cell in photogrammetry)
    assert set(truth) == {"0"}


def test_captions_name_the_captures_of_the_precision_where_they_are_others(result):
    formed = "(B, F, U, V, W) and then averaged, but for the pooled ones;"
    assert f"{formed} precision over the repeats of hand0, hand1, hand2;" in parts.caption(result)
    both = replace(result, about=result.about.model_copy(update={"captures": result.scored()}))
    assert f"{formed} in brackets" in parts.caption(both)


def test_a_busy_machine_is_said(result):
    """0.05 cores of other work are none; 0.9 are, for the method that was timed then."""
    assert "busy" not in parts.caption(result) and result.busy() == {}
    tasks = result.tasks.copy()
    tasks.loc[tasks.method == "broadband", "others_cores"] = 0.9
    busy = replace(result, tasks=tasks)
    assert busy.busy() == pytest.approx({"broadband": 0.9})
    note = (
        " The machine was busy: other work took up to 0.9 cores while Broadband were timed; "
        "their times are too long."
    )
    assert parts.caption(busy).endswith(f"on the machine named in the result.{note}")


def test_captions_explain_the_floor_where_there_is_one(result):
    assert "a perfect radar would show" in parts.caption(result)
    note = " Ground-truth floor, the MAE of a perfect radar: 0.126 mm against photogrammetry."
    assert parts.floor_note(result) == note
    for render, title in (
        (tables.markdown, "ground-truth floor (mm)"),
        (latex.latex, "ground-truth floor /"),
    ):
        assert render(result).count(title) == 2 and "a perfect radar" in render(result)


def test_results_of_earlier_versions_have_no_floor(result):
    """Neither rows nor the definition: nothing is shown, nothing explained."""
    metrics = {key: facts for key, facts in result.about.metrics.items() if key != "floor_mm"}
    table = result.table[result.table.metric != "floor_mm"]
    old = replace(result, table=table, about=result.about.model_copy(update={"metrics": metrics}))
    assert all(line.metric != "floor_mm" for block in parts.blocks(old) for line in block.lines)
    assert parts.floor_note(old) == ""
    assert not any(
        "floor" in render(old) for render in (tables.markdown, latex.latex, tables.csv_text)
    )


def test_an_unknown_floor_is_a_dash(result):
    table = result.table.copy()
    table.loc[table.metric == "floor_mm", ["value", "low", "high"]] = np.nan
    unknown = replace(result, table=table)
    assert set(cells(parts.blocks(unknown)[0], "floor_mm", "ours")) == {"–"}
    assert parts.floor_note(unknown) == ""


def test_what_was_not_measured_is_a_dash(result):
    table = result.table.assign(value=np.nan, low=np.nan, high=np.nan)
    block = parts.blocks(replace(result, table=table))[0]
    assert set(cells(block, "mae_mm", "ours")) == {"–"}
    assert set(cells(block, "mae_mm", "ours / paper")) == {"–"}


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (4.931, "mm", "4.93"),
        (0.08191, "s", "0.0819"),
        (43.36, "s", "43.4"),
        (1234.5, "s", "1234"),
        (-0.4, "mm", "−0.400"),
        (99.987, "%", "99.99"),
        (28771, "pixels", "28771"),
        (0.0, "mm", "0"),
        (None, "mm", "–"),
    ],
)
def test_figures_have_three_digits(value, unit, text):
    assert parts.figure(value, None, None, unit) == text


@pytest.mark.parametrize(
    ("value", "half", "unit", "text"),
    [
        (0.8721, 0.49, "mm", "0.87 [0.38, 1.36]"),
        (5.9463, 0.47, "mm", "5.95 [5.48, 6.42]"),
        (0.0412, 0.0004, "mm", "0.0412 [0.0408, 0.0416]"),
        (42.6, 15.0, "mm", "42.6 [27.6, 57.6]"),
        (43.36, 12.0, "s", "43 [31, 55]"),
        (97.97, 0.01, "%", "97.97 [97.96, 97.98]"),
        (0.5, 0.0, "mm", "0.500 [0.500, 0.500]"),
    ],
)
def test_an_interval_says_how_many_digits_are_worth_showing(value, half, unit, text):
    assert parts.figure(value, value - half, value + half, unit) == text


def compared(result: results.Result, p: float) -> results.Result:
    """broadband has the best MAE against the truth, 2-FSK and narrowband are worse with this p,
    3-FSK with 0.3."""
    lines = [
        (
            "mae_mm",
            "broadband",
            worse,
            1.0,
            0.5,
            1.5,
            "mm",
            chance,
            2.0,
            "truth",
            3,
            30,
            f"<b> {worse} |",
            "",
        )
        for worse, chance in (("2fsk", p), ("3fsk", 0.3), ("narrowband", p))
    ]
    return replace(result, files={**result.files, "comparisons": frame(COMPARISONS, lines)})


def test_only_what_a_test_stands_behind_stands_out(result):
    found = {
        (block.reference, line.metric): line.best
        for block in parts.blocks(compared(result, 1e-4))
        for line in block.lines
        if any(line.best)
    }
    assert found == {("truth", "mae_mm"): (False, True, True, False)}
    text = tables.markdown(compared(result, 1e-4))
    assert text.count("**") == 4 and "not shown to be worse" in text
    for other in (result, compared(result, 0.2)):
        assert "**" not in tables.markdown(other) and "Bold" not in tables.markdown(other)


def test_comparisons_are_sentences_with_their_p(result):
    text = tables.comparisons_markdown(compared(result, 1e-4))
    assert "| &lt;b&gt; 2fsk \\| | truth | < 0.001 | 2.00 | 3 |" in text and "| 0.30 |" in text
    assert tables.comparisons_markdown(result) == ""


def test_the_front_of_a_trade_off_is_bold():
    words = {"metric": "error", "definition": "d", "seconds": "s", "reference": "a"}
    section = Section(name="imaging", title="*x*", unit="mm", **words)
    facts = TradeoffFacts(name="sweep", scored_against="truth", sections=(section,))
    known = Setting(
        "imaging",
        "a",
        "a|b",
        "{}",
        "error",
        0.5,
        0.4,
        0.61,
        "mm",
        0.031,
        0.03,
        0.04,
        1.0,
        *(None,) * 6,
        True,
        "",
    )
    beaten = replace(known, title="b", error=None, seconds=None, ratio=None, on_front=False)
    text = tables.tradeoff_markdown(Tradeoff(Path(), facts, (known, beaten)))
    assert "| **a\\|b** | 0.50 \\[0.40, 0.61\\] | 0.0310 \\[0.0300, 0.0400\\] | 1.00 |" in text
    assert "| b | – | – | – |" in text and "## \\*x\\*" in text


def test_markdown_is_a_table_and_escapes(result, evil):
    text = tables.markdown(result)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert "| MAE (mm) | ours |" in text and "| paper | 6.6 | 1.7 | 1.0 | 13.4 |" in text
    assert "<b>" not in tables.markdown(evil)
    columns = {
        len(re.findall(r"(?<!\\)\|", line))
        for line in tables.markdown(evil).splitlines()
        if line[:1] == "|"
    }
    assert columns == {7}


def test_csv_carries_ratio_and_time(result):
    lines = list(csv.DictReader(io.StringIO(tables.csv_text(result))))
    assert len(lines) == len(result.table)
    line = next(
        i
        for i in lines
        if (i["metric"], i["method"], i["reference"]) == ("mae_mm", "3fsk", "truth")
    )
    assert float(line["ratio"]) == pytest.approx(float(line["value"]) / 1.7)
    assert float(line["seconds"]) == result.row("seconds", "3fsk", "truth").value
    assert all(i["seconds"] for i in lines)


def test_stages_are_medians_of_the_tasks(result):
    rest = (None, "", None, None, None)
    tasks = [
        (f"t{i}", "B", "3fsk", "image", s, s, None, i == 0, *rest)
        for i, s in enumerate((1.0, 2.0, 9.0))
    ]
    tasks.append(("sim", "B", "", "simulate", None, None, None, False, *rest))
    image, simulate = tables.stages(replace(result, tasks=frame(TASKS, tasks))).itertuples()
    assert (image.method, image.tasks, image.cached, image.seconds) == ("3-FSK", 3, 1, "2.00")
    assert (simulate.method, simulate.seconds, simulate.peak_memory_mb) == (
        "every method",
        "–",
        "–",
    )


def test_terminal_table_prints_names_as_they_are(evil, capsys):
    """rich would read [z] as markup; every headline metric and both blocks are there."""
    tables.show(evil)
    text = capsys.readouterr().out
    assert "[z]" in text and text.count("MAE (mm)") == 2 and text.count("time per frame (s)") == 2
    assert text.count("ground-truth floor (mm)") == 2
    assert "RMSE" not in text


def test_one_reference_makes_one_block(tmp_path):
    methods = {"3fsk": METHODS["3fsk"]}
    result = results.load(
        write_synthetic(tmp_path, captures=("B",), methods=methods, references=("truth",))
    )
    (block,) = parts.blocks(result)
    assert block.reference == "truth" and block.methods == ("3-FSK",)
