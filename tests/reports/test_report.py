"""The whole report, and its pictures."""

from __future__ import annotations

import re
import shutil
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest
from PIL import Image
from synthetic_result import METHODS, write_synthetic

from bench import results
from radar.errors import HandbenchError
from radar.files import read_json, write_json
from reports import html, maps
from reports.figures import pictures
from reports.style import STYLE

SCRIPT = "<script>alert(1)<&script>"  # as near to a closing tag as a file name gets


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One capture with a hostile name, two methods with hostile titles."""
    folder = write_synthetic(
        tmp_path_factory.mktemp("hostile"), captures=(SCRIPT,), step_m=3e-3,
        methods={"2fsk": (r"$\frac{<script>x</script>", *METHODS["2fsk"][1:]), "3fsk": METHODS["3fsk"]},
    )
    about = read_json(folder / "result.json", "")
    about["facts"]["<i>"] = ["<script>", {"a": None}]
    write_json(folder / "result.json", about | {"name": "<script>n</script>"})
    (folder / "config.toml").write_text('x = "</pre><script>"\n')
    return folder


@pytest.fixture(scope="module")
def report(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "out"
    html.build(folder, out)
    return out


def test_every_file_is_there_and_nothing_else(report):
    stems = ("accuracy_time", f"depth_{SCRIPT}", f"error_{SCRIPT}", "error_distribution", "repeats")
    expected = {"table.md", "table.tex", "table.csv", "index.html"}
    expected |= {f"figures/{stem}{suffix}" for stem in stems for suffix in (".png", ".pdf")}
    assert {str(path.relative_to(report)) for path in report.rglob("*") if path.is_file()} == expected
    assert all((report / name).stat().st_size > 500 for name in expected)


def test_pictures_are_not_empty(report):
    for png in report.glob("figures/*.png"):
        with Image.open(png) as image:
            pixels = np.asarray(image.convert("L"))
        assert min(pixels.shape) > 400 and pixels.std() > 5, png


class Tags(HTMLParser):
    """Collects tags, images and whether every opened tag is closed."""

    def __init__(self):
        super().__init__()
        self.names, self.images, self.open = set(), [], []

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_self_contained_and_escaped(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert not tags.names & {"script", "i", "link", "iframe"}
    assert len(tags.images) == 5
    assert all(image["src"].startswith("data:image/png;base64,") and len(image["alt"]) > 40 for image in tags.images)
    assert not re.search(r"(src|href)=\"?(http|/|\.)", text)
    assert "&lt;script&gt;" in text
    assert "prefers-color-scheme: dark" in text and "@media print" in text


def test_the_page_shows_and_explains_the_floor(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    assert text.count("ground-truth floor (mm)</th>") == 2  # a line in each table
    assert "MAE that a perfect radar would show against this reference" in text  # the definition
    assert "Ground-truth floor, the MAE of a perfect radar: 0.126 mm against photogrammetry." in text  # the error maps
    assert "together_mm</dt>" in text  # the budget


def test_a_result_without_a_floor_is_reported(folder, tmp_path):
    """A folder that an earlier version wrote: neither the rows nor the definition."""
    old = tmp_path / "old"
    shutil.copytree(folder, old)
    table = (old / "table.csv").read_text().splitlines(keepends=True)
    (old / "table.csv").write_text("".join(line for line in table if not line.startswith("floor_mm")))
    about = read_json(old / "result.json", "")
    del about["metrics"]["floor_mm"]
    write_json(old / "result.json", about)
    text = html.page(results.load(old), [], tmp_path)
    assert "MAE (mm)" in text and "floor" not in text


def test_building_again_replaces_and_leaves_strangers_alone(folder, report):
    (report / "notes.txt").write_text("mine")
    before = (report / "index.html").read_bytes()
    assert html.build(folder, report) == report / "index.html"
    assert (report / "notes.txt").read_text() == "mine"
    assert (report / "index.html").read_bytes() == before  # same data, same bytes


def test_never_writes_over_the_result(folder):
    before = (folder / "table.csv").read_bytes()
    with pytest.raises(HandbenchError, match="result folder itself"):
        html.build(folder, folder)
    assert (folder / "table.csv").read_bytes() == before


def test_no_result_no_report(tmp_path):
    with pytest.raises(HandbenchError, match="expected a folder"):
        html.build(tmp_path / "nothing", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def drawn(folder, stem):
    with matplotlib.rc_context(STYLE):
        return next(picture for picture in pictures(results.load(folder)) if picture.stem == stem)


def test_depth_maps_share_scale_and_axes_seen_from_the_array(result_folder):
    figure = drawn(result_folder, "depth_B").figure
    panels = [axis for axis in figure.axes if axis.images and axis.axison]
    titles = [axis.get_title().split("\n")[0] for axis in panels]
    assert titles == ["ground truth", "Broadband", "2-FSK", "3-FSK", "Narrowband"]
    assert len({axis.images[0].norm for axis in panels}) == 1
    assert len({(axis.get_xlim(), axis.get_ylim()) for axis in panels}) == 1
    left, right = panels[0].get_xlim()
    assert left > right  # x grows to the left
    assert "x in mm" in figure.texts[0].get_text() and panels[0].get_ylabel() == "y in mm"


def test_a_pixel_is_drawn_where_it_lies():
    """The pixel at x = 10 mm, y = 20 mm covers exactly 9…11 mm and 19…21 mm of the panel."""
    axis_m = np.array([0.008, 0.010, 0.012])
    assert maps._edges_mm(axis_m) == pytest.approx((7, 13))
    assert maps._edges_mm(axis_m + 0.010) == pytest.approx((17, 23))


def test_the_error_scale_is_the_same_for_every_capture(result_folder):
    scales = set()
    for capture in "BFU":
        picture = drawn(result_folder, f"error_{capture}")
        panels = [axis for axis in picture.figure.axes if axis.images]
        assert len(panels) == 8
        scales |= {(axis.images[0].norm.vmin, axis.images[0].norm.vmax) for axis in panels}
    assert scales == {(-50, 50)}


def test_nothing_observed_is_drawn_and_said(tmp_path):
    folder = write_synthetic(tmp_path, captures=("B",), methods={"3fsk": METHODS["3fsk"]}, step_m=5e-3)
    errors = results.load(folder).errors("B", "3fsk", "truth")
    empty = np.full_like(errors.error_m, np.nan)
    for reference in results.REFERENCES:
        blank = results.ErrorMap(errors.x_m, errors.y_m, empty, errors.reference_z_m)
        results.write_errors(folder, "B", "3fsk", reference, blank)
    results.write_surface(folder, "B", "3fsk", results.Surface(errors.x_m, errors.y_m, empty))
    html.build(folder, tmp_path / "report")
    assert "nothing observed" in (tmp_path / "report" / "index.html").read_text()
