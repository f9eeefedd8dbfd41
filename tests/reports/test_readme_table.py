"""The tables of README and docs/results.md: made from a result, and every way in which they can be
stale is noticed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.text import Text

from docs import readme
from handbench.bench import results
from handbench.bench.evaluation.tables import COMPARISONS, frame
from tests.reports.synthetic_result import write_synthetic

CONFIG = 'name = "x"\n[[capture]]\nscene = "hand.toml"\n[[capture]]\npath = "elsewhere"\n'


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> results.Result:
    """A synthetic result, of a scene, with comparisons as the methods are and under equal
    treatment."""
    figures = (1.0, 0.5, 1.5, "mm", 1e-4, 2.0, "photogrammetry", 3, 30, "")
    lines = [
        ("mae_mm", "3fsk", worse, *figures, treatment)
        for worse in ("2fsk", "broadband", "narrowband")
        for treatment in ("", "none")
    ]
    found = results.load(write_synthetic(tmp_path_factory.mktemp("result"), equal=True))
    files = {**found.files, "comparisons": frame(COMPARISONS, lines)}
    return replace(found, config=CONFIG, files=files)


@pytest.fixture
def root(result, tmp_path) -> Path:
    """A repository whose README was just written."""
    root = tmp_path / "repository"
    (root / "docs").mkdir(parents=True)
    (root / readme.SCENES).mkdir(parents=True)
    (root / readme.SCENES / "hand.toml").write_text('pose = "F"\n', "utf-8")
    for page in readme.PAGES:
        (root / page).write_text(
            "before\n<!-- table: begin -->\nstale words\n<!-- table: end -->\nafter\n", "utf-8"
        )
    readme.write(result, root)
    return root


def test_what_was_written_is_the_results_and_not_stale(result, root):
    text, equal_text = ((root / page).read_text("utf-8") for page in readme.PAGES)
    for page in (text, equal_text):
        assert page.startswith("before\n<!--") and page.endswith("-->\nafter\n")
        assert "stale words" not in page
    row = result.row("mae_mm", "3fsk", "photogrammetry")
    [mae] = [line for line in text.splitlines() if line.startswith("| MAE (mm) |")]
    assert f"| **{row.value:.2f}** \\[{row.low:.2f}, {row.high:.2f}\\] *1.7* |" in mae
    assert mae.count("**") == 2 and mae.endswith("| – | – |")  # it has no methods of ours
    findings = [line for line in equal_text.splitlines() if line.startswith("- ")]
    assert len(findings) == 2 and "3-FSK better by 1.0 mm unsmoothed \\[0.5" in findings[0]
    assert (root / "docs" / "depth_F.png").read_bytes().startswith(b"\x89PNG")
    assert readme.stale(root) == readme.disagreements(result, root) == []


def test_the_figure_has_eight_panels_and_can_be_read_900_pixels_wide(result):
    """Photograph, truth, and depth and error of three methods, with two colour scales; letters of
    11 pixels and more."""
    figure = readme.draw(result)
    assert len(figure.axes) == 8 + 2
    points = min(text.get_fontsize() for text in figure.findobj(Text) if text.get_text())
    assert points / 72 * 900 / figure.get_figwidth() >= 11


@pytest.mark.parametrize(
    ("file", "problem"),
    [
        ("README.md", "the table is not what"),
        ("docs/results.md", "the table is not what"),
        ("docs/depth_F.png", "docs/depth_F.png: is not the figure"),
        ("bench/run/benchmarks/hand.toml", "hand.toml: has changed"),
    ],
)
def test_each_change_of_the_repository_is_noticed(root, file, problem):
    text = "<!-- table: begin -->\nby hand\n<!-- table: end -->\n"
    (root / file).write_text('pose = "B"' if file.endswith("toml") else text, "utf-8")
    [found] = readme.stale(root)
    assert problem in found


def test_a_fresh_result_that_prints_other_figures_is_noticed(result, root):
    """1.2 µm of 1.20 mm are not, and times are the machine's."""
    for metric, factor, starts in (
        ("mae_mm", 1.001, []),
        ("seconds", 3.0, []),
        ("mae_mm", 1.1, ["mae_mm of 3fsk: "]),
    ):
        table = result.table.copy()
        table.loc[(table.metric == metric) & (table.method == "3fsk"), "value"] *= factor
        found = readme.disagreements(replace(result, table=table), root)
        assert [line[: len(start)] for line, start in zip(found, starts, strict=True)] == starts
    untested = replace(result, files={**result.files, "comparisons": frame(COMPARISONS)})
    [found] = readme.disagreements(untested, root)
    assert found.startswith("best: ")
