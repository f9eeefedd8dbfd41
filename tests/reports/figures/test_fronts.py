"""The report of a trade-off: fronts and claims; alone and beside a result."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

from handbench.bench import results
from handbench.reports.figures import fronts
from handbench.reports.page import html, rendering, tradeoff_section
from handbench.support.errors import HandbenchError
from tests.reports.synthetic_result import METHODS, write_synthetic, write_synthetic_tradeoff


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_synthetic_tradeoff(tmp_path_factory.mktemp("tradeoff"))


@pytest.fixture(scope="module")
def found(folder):
    return results.load_tradeoff(folder)


def test_a_folder_alone_becomes_a_page_with_pictures_for_papers(folder, tmp_path):
    assert html.build(folder, tmp_path) == tmp_path / "index.html"
    stems = ("front_imaging", "front_groundtruth")
    pictures = {f"{stem}{suffix}" for stem in stems for suffix in (".png", ".pdf")}
    files = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert files == {"index.html", "front.md", "front.tex", *pictures}
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    for shown in ("groundtruth", "× 1000", "× 31.5", "Broadband, 0.01"):
        assert shown in text


def test_a_sweep_without_settings_is_refused(found, tmp_path):
    results.write_tradeoff(tmp_path, found.facts, [])
    with pytest.raises(HandbenchError, match="has no settings"):
        tradeoff_section.build(tmp_path, tmp_path / "out")


@pytest.mark.parametrize("inside", [True, False])
def test_a_result_shows_the_sweep_that_it_holds_or_is_given(tmp_path, monkeypatch, inside):
    folder = write_synthetic(
        tmp_path / "r", ("B",), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    sweep = write_synthetic_tradeoff((folder if inside else tmp_path) / "tradeoff")
    monkeypatch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])
    page = html.build(folder, tmp_path / "out", None if inside else sweep)
    text = page.read_text(encoding="utf-8")
    assert 'href="#tradeoff"' in text and 'id="sweep-imaging"' in text and "table" in text


def test_points_that_lie_together_share_a_label():
    """One point per decade would have its own; the second, third and fifth lie together."""
    axis = Figure().subplots()
    axis.set(xscale="log", yscale="log", xlim=(1e-3, 1), ylim=(0.1, 10))
    places = [(2e-3, 5.0), (0.1, 1.0), (0.101, 1.0), (0.1015, 3.0), (0.102, 1.01)]
    settings = [SimpleNamespace(seconds=s, error=e) for s, e in places]
    expected = [("1", places[0]), ("2–3, 5", places[1]), ("4", places[3])]
    assert list(fronts._labels(axis, settings)) == expected
