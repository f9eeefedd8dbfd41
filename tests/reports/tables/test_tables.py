"""Tables of the golden result, in every format: they are the files of tests/golden, read by people
when they change."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from handbench.bench.evaluation.tables import COMPARISONS, frame
from handbench.bench.results.result_folder import Result, load
from handbench.cli.benchmarks import show_result
from handbench.reports.figures.fronts import ranked_methods
from handbench.reports.page import sections, summary
from handbench.reports.tables import table as tables
from handbench.reports.tables.rounding import figure
from handbench.reports.tables.writers import html, latex, markdown
from tests.golden_files import RESULT

WRITERS = {"md": markdown, "tex": partial(latex, "tab:each"), "html": html}


def judged(p: float) -> Result:
    """The golden result where broadband has the best MAE against the truth: the others are worse
    with this p, 3-FSK with 0.3."""
    result = replace(load(RESULT))
    figures = (1.0, 0.5, 1.5, "mm")
    lines = [
        ("mae_mm", "broadband", worse, *figures, chance, 2.0, "truth", 3, f"<b> {worse} |", of)
        for worse, chance in (("2fsk", p), ("3fsk", 0.3), ("joint", p))
        for of in ("", "none")
    ]
    result.__dict__["comparisons"] = frame(COMPARISONS, lines)
    return result


@pytest.mark.parametrize("kind", WRITERS)
def test_tables_have_every_figure_its_interval_the_papers_and_stars(kind, golden):
    result = judged(1e-4)
    shown = [summary.main_table(result), *tables.every_figure(result), tables.of_paper(result)]
    shown += [tables.differences(result, main) for main in (True, False)]
    ranked = ranked_methods(result).items()
    shown += [tables.settings(result, *item, result.about.method_titles) for item in ranked]
    golden("\n".join(map(WRITERS[kind], shown)), f"tables.{kind}")


def test_the_main_pairs_have_a_foreign_method():
    result = judged(0.2)
    lines = result.comparisons.replace({"better": {"broadband": "3fsk"}})
    for id, pairs in (("joint", 1), ("theirs", 2)):
        methods = tuple(of.model_copy(update={"id": id}) for of in result.about.methods[3:])
        foreign = replace(result, about=result.about.model_copy(update={"methods": methods}))
        foreign.__dict__["comparisons"] = lines
        assert len(tables.differences(foreign, main=True).texts) == pairs


def test_without_a_test_no_figure_has_a_star_and_without_the_papers_no_table():
    result = judged(0.2)
    assert "★" not in markdown(tables.every_figure(result)[1])
    assert tables.of_paper(replace(result, table=result.table.assign(paper=float("nan")))) is None


def test_a_mesh_of_the_captures_own_and_its_fit_are_named_and_its_uncertainty_may_be_unknown():
    result = load(RESULT)
    captures = tuple(c.model_copy(update={"own_mesh": True}) for c in result.about.captures)
    budget = {"mesh_mm": None, "registration_mm": 0.1, "together_mm": None, "unknown": ["mesh"]}
    facts = {"groundtruth_sigma_rms": {captures[0].name: budget}}
    facts["refined_transforms"] = {captures[0].name: "by its depth map"}
    about = result.about.model_copy(update={"captures": captures, "facts": facts})
    result = replace(result, about=about)
    caption = summary.main_table(result).caption
    assert caption.startswith("Against mesh.ply, fitted to the depth maps of 1 capture")
    [sigmas, *_] = sections.uncertainty(result)
    assert sigmas.texts.to_numpy().tolist() == [["–", "0.10", "–"]]


@pytest.mark.parametrize("columns", [40, 80])
def test_a_run_ends_with_the_papers_table_and_our_best(columns, golden, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    show_result(load(RESULT), Path("OUT"))
    golden(capsys.readouterr().out, f"run_{columns}.txt")


@pytest.mark.parametrize(
    ("value", "half", "unit", "text"),
    [
        (4.931, None, "mm", "4.9"),
        (1234.5, None, "s", "1234"),
        (-0.4, None, "mm", "−0.40"),
        (None, None, "mm", "–"),
        (0.8721, 0.49, "mm", "0.87 [0.38, 1.36]"),
        (43.36, 12.0, "s", "43 [31, 55]"),
        (97.347, None, "%", "97.3"),
    ],
)
def test_figures_have_two_digits_or_those_that_their_interval_is_worth(value, half, unit, text):
    ends = (None, None) if half is None else (value - half, value + half)
    assert figure(value, *ends, unit) == text
