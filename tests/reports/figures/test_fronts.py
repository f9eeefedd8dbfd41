"""The report of a trade-off: fronts, where time goes, claims; alone and beside a result."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from matplotlib.text import Text

from handbench.bench import results
from handbench.reports.figures import fronts
from handbench.reports.figures.style import COLUMN, STYLE, method_styles
from handbench.reports.page import html, rendering, tradeoff_section
from handbench.support.errors import HandbenchError
from tests.reports.synthetic_result import METHODS, write_synthetic, write_synthetic_tradeoff

EVIL = r"<b>$\frac{x</b>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_synthetic_tradeoff(tmp_path_factory.mktemp("tradeoff"), tolerances=2)


@pytest.fixture(scope="module")
def found(folder):
    return results.load_tradeoff(folder)


@pytest.fixture(scope="module")
def drawn(found):
    """The pictures by name."""
    with matplotlib.rc_context(STYLE):
        pictures = {picture.stem: picture for picture in fronts.pictures(found)}
        for picture in pictures.values():
            picture.figure.draw_without_rendering()
        return pictures


def test_a_folder_alone_becomes_a_page_with_pictures_for_papers(folder, tmp_path):
    assert html.build(folder, tmp_path) == tmp_path / "index.html"
    stems = ("front_imaging", "time_imaging", "front_groundtruth")
    expected = {
        "index.html",
        "front.md",
        "front.tex",
        *(f"figures/{s}{e}" for s in stems for e in (".png", ".pdf")),
    }
    assert {
        str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()
    } == expected
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    for shown in (
        "Photogrammetry",
        "× 1000",
        "× 31.5",
        "3-FSK takes a thousandth",
        "Broadband, 0.01",
    ):
        assert shown in text


def test_the_front_is_a_falling_line_through_what_nothing_beats(found, drawn):
    axis = drawn["front_imaging"].figure.axes[0]
    line = axis.lines[0]
    best = sorted((s.seconds, s.error) for s in found.section("imaging") if s.on_front)
    assert np.column_stack(line.get_data()) == pytest.approx(np.array(best))
    assert np.all(np.diff(line.get_ydata()) < 0)
    assert axis.get_xscale() == axis.get_yscale() == "log"
    assert axis.get_xlabel() == "seconds" and axis.get_ylabel() == "MAE in mm"


def test_beaten_settings_differ_in_more_than_colour(drawn):
    axis = drawn["front_imaging"].figure.axes[0]
    points = [
        line for line in axis.lines[1:] if line.get_marker() in "os^" and line.get_markersize() < 10
    ]
    fills = {line.get_fillstyle() for line in points}
    assert len(points) == 6 and fills == {"full", "none"}
    assert {line.get_color() for line in points} == {
        method_styles([])[name][0] for name in ("2fsk", "3fsk", "broadband")
    }


@pytest.mark.parametrize("style", [STYLE, COLUMN], ids=["page", "column"])
def test_numbers_of_a_crowded_front_do_not_meet(found, style):
    """Thirty settings, ten of them within a marker of each other: every one has its number and its
    line in the legend, and no number lies on another, as the renderer measures them."""
    about, first = found.facts.sections[0], found.section("imaging")[0]
    random = np.random.default_rng(0)
    places = np.vstack([random.uniform(0, 1, (20, 2)), 0.5 + 0.01 * random.uniform(-1, 1, (10, 2))])
    settings = tuple(
        replace(
            first, name=f"s{i}", title=f"setting {i} of a name that is long", on_front=True, low=None, high=None,
            error=0.1 * 100**y, seconds=0.01 * 100**x, seconds_low=0.009 * 100**x, seconds_high=0.012 * 100**x,
        )
        for i, (x, y) in enumerate(places)
    )  # fmt: skip
    with matplotlib.rc_context(style):
        figure = fronts.front(about, settings).figure
        figure.draw_without_rendering()
        axis = figure.axes[0]
        boxes = [Text.get_window_extent(text) for text in axis.texts]
        assert [text.get_text() for text in axis.texts] == [str(i) for i in range(1, 31)]
        assert [(a, b) for a, b in combinations(range(30), 2) if _meet(boxes[a], boxes[b])] == []
        assert all(axis.bbox.containsx(box.x0) and axis.bbox.containsy(box.y0) for box in boxes)
        assert {f"{text.get_text().split()[0]}" for text in figure.legends[-1].texts} == set(
            map(str, range(1, 31))
        )
        frames = [legend.get_window_extent() for legend in figure.legends]
        assert all(
            figure.bbox.y0 <= frame.y0 and frame.y1 <= figure.bbox.y1 + 1 for frame in frames
        )


def _meet(a, b):
    """Boxes that share more than a hair: the renderer's have a font's whole height, of which digits
    fill 3/4."""
    wide, high = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
    return wide > 1 and high > 0.25 * a.height


def test_ratios_stand_above_the_seconds(found, drawn):
    (above,) = drawn["front_imaging"].figure.axes[0].child_axes
    reference = next(
        s for s in found.section("imaging") if s.name == found.facts.sections[0].reference
    )
    seconds, ratios = (
        np.array(axis.get_xlim()) for axis in (drawn["front_imaging"].figure.axes[0], above)
    )
    assert seconds / ratios == pytest.approx(reference.seconds)


def test_bars_add_up_to_the_whole(found, drawn):
    bars = (
        drawn["time_imaging"].figure.axes[0].containers
    )  # of the frame; the plan stands beside it
    assert sum(np.array([bar.get_width() for bar in part]) for part in bars) == pytest.approx(100)
    assert len({bar.patches[0].get_hatch() for bar in bars}) > 1
    assert "time_groundtruth" not in drawn  # whose parts are not known


def test_what_has_no_place_on_logarithmic_axes_stands_in_the_table(found):
    about = found.facts.sections[0]
    first = found.section("imaging")[0]
    exact = replace(
        first, name=about.reference, title="exact", error=0.0, low=None, high=None, on_front=True
    )
    refused = replace(
        exact,
        name="refused",
        title="refused",
        error=None,
        seconds=None,
        on_front=False,
        dominated_by="",
    )
    settings = (exact, refused, *found.section("imaging")[1:])
    with matplotlib.rc_context(STYLE):
        picture = fronts.front(about, settings)
        picture.figure.draw_without_rendering()
    assert "no place on these axes" in picture.caption and "square" not in picture.caption
    rows = {row[0]: row[1:4] for row in tradeoff_section.settings_grid(about, settings).rows}
    assert rows["refused"] == ("–", "–", "–") and rows["exact"][:2] == ("front", "0")


def test_hostile_names_are_text(found, tmp_path, monkeypatch):
    settings = [replace(s, title=EVIL) for s in found.settings]
    results.write_tradeoff(tmp_path, found.facts, settings)
    monkeypatch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])
    text = tradeoff_section.build(tmp_path, tmp_path / "out").read_text(encoding="utf-8")
    assert "<b>$" not in text and "&lt;b&gt;$" in text


@pytest.mark.parametrize("knobs", ["", "[1]", '{"tolerance": 1}'])
def test_a_setting_without_a_method_has_none(found, knobs):
    assert replace(found.settings[0], knobs=knobs).method == ""


def test_a_sweep_without_settings_is_refused(found, tmp_path):
    results.write_tradeoff(tmp_path, found.facts, [])
    with pytest.raises(HandbenchError, match="holds no setting"):
        tradeoff_section.build(tmp_path, tmp_path / "out")


@pytest.mark.parametrize("inside", [True, False])
def test_a_result_shows_the_sweep_that_it_holds_or_is_given(tmp_path, monkeypatch, inside):
    folder = write_synthetic(
        tmp_path / "r", ("B",), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    sweep = write_synthetic_tradeoff(
        folder / "tradeoff" if inside else tmp_path / "sweep", tolerances=2
    )
    monkeypatch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])
    page = html.build(folder, tmp_path / "out", None if inside else sweep)
    text = page.read_text(encoding="utf-8")
    assert 'href="#tradeoff"' in text and 'id="sweep-imaging"' in text and "table" in text
