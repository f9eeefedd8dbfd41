"""The section on causes draws and tables what causes.csv and reliability.csv say; older results
have no such part."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from handbench.bench import results
from handbench.bench.evaluation.tables import each
from handbench.radar.data.depthmap import DepthMap
from handbench.reports.figures.charts import CAUSES, cause_charts
from handbench.reports.page import html, sections
from handbench.reports.tables.blocks import number
from tests.bench.evaluation.explained import Scored, explain
from tests.reports.synthetic_result import METHODS, write_synthetic

SIGMAS_M = {"2fsk": 6e-3, "3fsk": 1.5e-3, "broadband": None}


@pytest.fixture(scope="module")
def told(result_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> results.Result:
    """The synthetic result with causes, and with σ for two of its methods."""
    folder = tmp_path_factory.mktemp("told") / "table"
    shutil.copytree(result_folder, folder)
    return tell(folder, ("2fsk", "3fsk", "broadband"))


def tell(folder: Path, methods: tuple[str, ...]) -> results.Result:
    """A synthetic result, to which the causes of some methods' errors were added."""
    old = results.load(folder)
    assert not len(old.causes) and not len(old.reliability)
    maps, rng = [], np.random.default_rng(4)
    for capture in old.scored()[:2]:
        for reference in capture.references:
            for method in methods:
                sigma_m = SIGMAS_M[method]
                errors = old.errors(capture.name, method, reference)
                level_db = rng.uniform(-14, 0, errors.error_m.shape)
                sigma = None if sigma_m is None else np.full(errors.error_m.shape, sigma_m)
                z_m = errors.reference_z_m + errors.error_m
                maps.append(
                    Scored(
                        method,
                        reference,
                        DepthMap(errors.x_m, errors.y_m, z_m, level_db, method, {}, sigma),
                        errors,
                    )
                )
    results.write_tables(folder, **explain(maps))
    return results.load(folder)


def drawn(axis: Axes) -> dict[str, list[float]]:
    return {
        line.get_label(): list(line.get_ydata())
        for line in axis.lines
        if not line.get_label().startswith("_")
    }


def test_pictures_show_what_the_tables_say(told):
    first, _, reliable = cause_charts(told)
    lines = told.causes[
        (told.causes.reference == "photogrammetry") & (told.causes.method == "3fsk")
    ]
    shown = [cause for cause in CAUSES if (lines.cause == cause).any()]
    for column, cause in enumerate(shown):
        mine = lines[lines.cause == cause].sort_values(["low", "part"])
        for row, name in enumerate(("absolute_mm", "mean_mm")):
            axis = first.figure.axes[row * len(shown) + column]
            assert drawn(axis)["3-FSK"] == pytest.approx(mine[name].tolist())
    mine = told.reliability[
        (told.reliability.method == "2fsk") & (told.reliability.reference == "truth")
    ]
    expected = mine.observed_percent[mine.pixels == "all"].tolist()
    assert drawn(reliable.figure.axes[1])["2-FSK"] == pytest.approx(expected)
    assert set(drawn(reliable.figure.axes[1])) == {"2-FSK", "3-FSK"}


def test_tables_have_every_bin_and_method(told):
    grid = sections.by_cause(told)[0]
    assert grid.headings == ("cause", "bin", "Broadband", "2-FSK", "3-FSK", "Narrowband")
    lines = told.causes[
        (told.causes.reference == "photogrammetry") & (told.causes.method == "3fsk")
    ]
    assert len(grid.rows) == len(lines)
    cells = {row[4] for row in grid.rows}
    for line in each(lines):
        assert (
            f"{number(line.absolute_mm, 2)} [{number(line.mean_mm, 2)}] "
            f"{line.n_pixels}/{line.n_captures}" in cells
        )
    assert {row[5] for row in grid.rows} == {"–"}
    table = sections.reliability(told)[0]
    assert [row[:2] for row in table.rows] == [
        (m, p) for m in ("2-FSK", "3-FSK") for p in ("all", "not flagged")
    ]


def test_the_page_has_the_section_and_that_of_an_older_result_does_not(result_folder, tmp_path):
    small = write_synthetic(
        tmp_path / "r", ("B",), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    html.build(tell(small, ("3fsk",)).folder, tmp_path / "new")
    assert 'id="causes"' in (tmp_path / "new" / "index.html").read_text("utf-8")
    assert {"causes__truth.png", "reliability.pdf"} <= {
        p.name for p in (tmp_path / "new" / "figures").iterdir()
    }
    assert sections.causes(results.load(result_folder), tmp_path) is None
