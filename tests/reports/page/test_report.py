"""The whole report, and its pictures."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text
from PIL import Image

from handbench.bench import results
from handbench.bench.evaluation.paired import compare
from handbench.bench.evaluation.tables import COMPARISONS, frame
from handbench.reports.figures.charts import error_counts, overview, total_counts
from handbench.reports.figures.depth_maps import panels
from handbench.reports.figures.layers import edges
from handbench.reports.figures.style import COLOURS, COLUMN, MARKERS, PAGE, STYLE, method_styles
from handbench.reports.page import html, rendering, scene3d, sections
from handbench.reports.page.rendering import render
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json
from tests.reports.synthetic_result import METHODS, write_synthetic

SCRIPT = "<script>alert(1)<&script>"  # as near to a closing tag as a file name gets


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One capture with a hostile name, two methods with hostile titles."""
    folder = write_synthetic(
        tmp_path_factory.mktemp("hostile"),
        captures=(SCRIPT,),
        step_m=3e-3,
        methods={
            "2fsk": (r"$\frac{<script>x</script>", *METHODS["2fsk"][1:]),
            "3fsk": METHODS["3fsk"],
        },
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
    own = (f"depth_{SCRIPT}", f"error_{SCRIPT}__truth")
    stems = ("accuracy_time", *own, "error_distribution", "repeats")
    expected = {"table.md", "table.tex", "column.tex", "table.csv", "index.html"}
    expected |= {f"figures/{stem}{suffix}" for stem in stems for suffix in (".png", ".pdf")}
    assert {
        str(path.relative_to(report)) for path in report.rglob("*") if path.is_file()
    } == expected
    assert all((report / name).stat().st_size > 500 for name in expected)


def test_pictures_are_not_empty(report):
    for png in report.glob("figures/*.png"):
        with Image.open(png) as image:
            pixels = np.asarray(image.convert("L"))
        assert min(pixels.shape) > 400 and pixels.std() > 5, png


class Tags(HTMLParser):
    """Collects tags, images, scripts, ids, and whether every opened tag is closed."""

    def __init__(self):
        super().__init__()
        self.names, self.images, self.scripts, self.ids, self.meta, self.open = (
            set(),
            [],
            [],
            [],
            [],
            [],
        )

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        self.ids += [value for name, value in attrs if name == "id"]
        self.images += [dict(attrs)] * (tag == "img")
        self.meta += [dict(attrs)] * (tag == "meta")
        if tag == "script":
            self.scripts.append([dict(attrs).get("type"), ""])
        if tag not in ("img", "meta", "input"):
            self.open.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] in ("script", "style"):
            self.scripts += [[self.open[-1], ""]] * (self.open[-1] == "style")
            self.scripts[-1][1] += data

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(file):
    tags = Tags()
    tags.feed(file.read_text(encoding="utf-8"))
    return tags


def test_the_page_is_self_contained_and_escaped(report):
    text, tags = (report / "index.html").read_text(encoding="utf-8"), parsed(report / "index.html")
    assert tags.open == []
    assert not tags.names & {"i", "link", "iframe", "object"}
    assert len(tags.images) == 6
    assert all(
        image["src"].startswith("data:image/webp;base64,") and len(image["alt"]) > 40
        for image in tags.images
    )
    assert not re.search(r"(src|href)=\"?(http|/|\.)", text)
    assert "&lt;script&gt;" in text
    assert text.count('href="figures/depth_%3Cscript') == 2  # PDF and PNG
    assert "prefers-color-scheme: dark" in text and "@media print" in text
    assert len(tags.ids) == len(set(tags.ids))


def test_the_policy_lets_in_our_style_and_script_alone(report):
    tags = parsed(report / "index.html")
    (policy,) = (
        meta["content"] for meta in tags.meta if meta.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy.startswith("default-src 'none'; img-src data:;") and "unsafe" not in policy
    assert [kind for kind, _ in tags.scripts] == [
        "style",
        "application/json",
        "application/json",
        None,
    ]
    for kind, content in (tags.scripts[0], tags.scripts[-1]):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{'style' if kind else 'script'}-src 'sha256-{digest}'" in policy


def test_the_page_shows_and_explains_the_floor(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    assert text.count("ground-truth floor (mm)</th>") == 2  # a line in each table
    assert "MAE that a perfect radar would show against this reference" in text  # the definition
    assert (
        "Ground-truth floor, the MAE of a perfect radar: 0.126 mm against photogrammetry." in text
    )  # the error maps
    assert "together (mm)</th>" in text  # the budget


@pytest.fixture
def undrawn(monkeypatch):
    """A report without pictures, where words are looked at."""
    monkeypatch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])


def test_a_result_without_a_floor_is_reported(folder, tmp_path, undrawn):
    """A folder that an earlier version wrote: neither the rows nor the definition."""
    old = tmp_path / "old"
    shutil.copytree(folder, old)
    table = (old / "table.csv").read_text().splitlines(keepends=True)
    (old / "table.csv").write_text(
        "".join(line for line in table if not line.startswith("floor_mm"))
    )
    about = read_json(old / "result.json", "")
    del about["metrics"]["floor_mm"]
    write_json(old / "result.json", about)
    html.build(old, tmp_path / "out")
    text = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert "MAE (mm)" in text and "truth floor" not in text


def test_building_again_replaces_and_leaves_strangers_alone(folder, tmp_path, undrawn):
    before = html.build(folder, report := tmp_path / "report").read_bytes()
    (report / "notes.txt").write_text("mine")
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
    result = results.load(folder)
    with matplotlib.rc_context(STYLE):
        for capture in result.scored():
            found = next(
                (picture for picture in panels(result, capture) if picture.stem == stem), None
            )
            if found:
                return found
        return next(picture for picture in overview(result) if picture.stem == stem)


def test_depth_maps_share_scale_and_axes_seen_from_the_array(result_folder):
    figure = drawn(result_folder, "depth_B").figure
    shown = [axis for axis in figure.axes if axis.images and axis.axison]
    titles = [axis.get_title().split("\n")[0] for axis in shown]
    assert titles[:5] == ["ground truth", "Broadband", "2-FSK", "3-FSK", "Narrowband"]
    assert len(shown) == 9 and all(
        title.startswith("MAE ") for title in titles[5:]
    )  # each below its depths
    places = [(axis.get_position().x0, axis.get_position().y0) for axis in shown]
    assert all(
        a[0] == pytest.approx(b[0]) and a[1] > b[1]
        for a, b in zip(places[1:5], places[5:], strict=True)
    )
    assert (
        len({axis.images[0].norm for axis in shown[:5]})
        == len({(axis.images[0].norm.vmax) for axis in shown[5:]})
        == 1
    )
    assert len({(axis.get_xlim(), axis.get_ylim()) for axis in shown}) == 1
    left, right = shown[0].get_xlim()
    assert left > right  # x grows to the left
    assert "x in mm" in figure.texts[0].get_text() and shown[0].get_ylabel() == "y in mm"


def test_a_pixel_is_drawn_where_it_lies():
    """The pixel at x = 10 mm, y = 20 mm covers exactly 9…11 mm and 19…21 mm of the panel."""
    axis_m = np.array([0.008, 0.010, 0.012])
    assert edges(1e3 * axis_m) == pytest.approx((7, 13))
    assert edges(1e3 * axis_m + 10) == pytest.approx((17, 23))


def test_the_error_scale_is_the_same_for_every_capture(result_folder):
    scales = set()
    for capture in "BFU":
        picture = drawn(result_folder, f"error_{capture}__truth")
        shown = [axis for axis in picture.figure.axes if axis.images]
        assert len(shown) == 4
        below = [
            axis
            for axis in drawn(result_folder, f"depth_{capture}").figure.axes
            if "MAE" in axis.get_title()
        ]
        shown += below
        scales |= {(axis.images[0].norm.vmin, axis.images[0].norm.vmax) for axis in shown}
    assert scales == {(-50, 50)}


def test_nothing_observed_is_drawn_and_said(tmp_path):
    folder = write_synthetic(
        tmp_path, captures=("B",), methods={"3fsk": METHODS["3fsk"]}, step_m=5e-3
    )
    errors = results.load(folder).errors("B", "3fsk", "truth")
    empty = np.full_like(errors.error_m, np.nan)
    for reference in results.REFERENCES:
        blank = results.ErrorMap(errors.x_m, errors.y_m, empty, errors.reference_z_m)
        results.write_errors(folder, "B", "3fsk", reference, blank)
    results.write_surface(folder, "B", "3fsk", results.SurfaceMap(errors.x_m, errors.y_m, empty))
    assert "3-FSK: nothing observed" in drawn(folder, "depth_B").alt
    assert (
        scene3d.scene(results.load(folder), results.load(folder).scored()[0])["surfaces"][-1][
            "pixels"
        ]
        == 0
    )


def every_picture(result):
    """All pictures of a result but those of the other captures."""
    yield from overview(result)
    yield from panels(result, result.scored()[0])


def test_pictures_of_a_column_are_as_wide_as_one_with_8_pt(result_folder):
    """3.5 inches and 8 points: IEEEtran's column and footnotes; nothing lies outside."""
    with matplotlib.rc_context(COLUMN):
        for picture in every_picture(results.load(result_folder)):
            figure = picture.figure
            assert figure.get_figwidth() == 3.5
            figure.draw_without_rendering()
            texts = [t for t in figure.findobj(Text) if t.get_text() and t.get_visible()]
            assert {t.get_fontsize() for t in texts} == {8}, picture.stem
            box = figure.get_tightbbox()
            assert box.x0 > -0.02 and box.x1 < 3.52 and box.y0 > -0.02, picture.stem


def test_pictures_can_be_read_on_light_and_on_dark_pages(result_folder, tmp_path):
    """Contrast of 4 at least of text on both pages, and of 2 of the methods' marks; nothing
    behind."""
    pages = [np.ones(3), np.array(to_rgb("#16181b"))]
    with matplotlib.rc_context(PAGE):
        for picture in every_picture(results.load(result_folder)):
            figure = picture.figure
            texts = [t for t in figure.findobj(Text) if t.get_text() and t.get_visible()]
            inks = {(to_rgb(t.get_color()), 4) for t in texts}
            marks = {(to_rgb(colour), 2) for colour in COLOURS}
            for colour, least in inks | marks:
                for page in pages:
                    lighter, darker = sorted(map(luminance_of, (colour, page)), reverse=True)
                    assert (lighter + 0.05) / (darker + 0.05) > least, (picture.stem, colour)
            figure.savefig(tmp_path / "picture.png", dpi=50)
            with Image.open(tmp_path / "picture.png") as image:
                assert np.asarray(image)[0, 0, 3] == 0


def test_errors_are_counted_alike_page_by_page_and_together(result_folder):
    result = results.load(result_folder)
    parts = [error_counts(result, [capture]) for capture in result.scored()]
    together = error_counts(result, result.scored())
    for key, counts in total_counts(parts).items():
        np.testing.assert_array_equal(counts, together[key])
    errors = [result.errors(c.name, "3fsk", "truth").error_m for c in result.scored()]
    assert together["3fsk", "truth"][-1] == sum(np.isfinite(e).sum() for e in errors)


def luminance_of(rgb):
    """Relative luminance (WCAG 2), with its linear part left out: the colours here are none so dark
    but the page."""
    return float(np.asarray(rgb) ** 2.4 @ [0.2126, 0.7152, 0.0722])


def test_the_distribution_of_errors_is_that_of_all_captures(result_folder):
    result = results.load(result_folder)
    axis = drawn(result_folder, "error_distribution").figure.axes[0]
    (line,) = (line for line in axis.lines if line.get_label() == "3-FSK")
    error_m = np.concatenate(
        [result.errors(c, "3fsk", "photogrammetry").error_m.ravel() for c in "BFUVW"]
    )
    error_mm = 1e3 * np.abs(error_m[np.isfinite(error_m)])
    at = 200
    assert line.get_ydata()[at] == pytest.approx(100 * np.mean(error_mm <= line.get_xdata()[at]))


def test_every_method_has_its_own_look_whatever_else_is_shown():
    assert method_styles(["3fsk"])["3fsk"] == method_styles(["mine", "3fsk", "2fsk"])["3fsk"]
    many = method_styles([f"m{i}" for i in range(60)])
    assert len(set(many.values())) == len(many) and len(COLOURS) == len(MARKERS)


def depths_mm(scene, surface):
    """Depths [rows, columns] of a surface as the view decodes them."""
    seen = np.unpackbits(np.frombuffer(base64.b64decode(surface["seen"]), np.uint8))
    seen = seen[: np.prod(surface["shape"])].reshape(surface["shape"]).astype(bool)
    z_mm = np.full(surface["shape"], np.nan)
    z_mm[seen] = scene["low_mm"] + scene["step_mm"] * np.frombuffer(
        base64.b64decode(surface["z"]), "<u2"
    )
    return z_mm


def test_what_turns_in_3d_is_what_was_measured(result_folder):
    """Depths to half a step, errors to half of theirs, pixels in their places."""
    result = results.load(result_folder)
    scene = json.loads(json.dumps(scene3d.scene(result, result.scored()[1])))
    surface = next(s for s in scene["surfaces"] if s["name"] == "3fsk")
    z_mm, measured = depths_mm(scene, surface), result.surface("F", "3fsk")
    ys, xs = (
        np.linspace(*surface[f"{side}_mm"], n)
        for side, n in zip("yx", surface["shape"], strict=True)
    )
    assert surface["pixels"] == np.isfinite(z_mm).sum() == np.isfinite(measured.z_m).sum()
    rows, columns = (
        np.searchsorted(1e3 * axis + 0.5, at)
        for axis, at in ((measured.y_m, ys), (measured.x_m, xs))
    )
    inside = np.ix_(rows, columns)
    np.testing.assert_allclose(z_mm, 1e3 * measured.z_m[inside], atol=0.51 * scene["step_mm"])
    error_m = result.errors("F", "3fsk", "truth").error_m[inside][np.isfinite(z_mm)]
    steps = np.frombuffer(base64.b64decode(surface["errors"]["truth"]["steps"]), "<i2").astype(
        float
    )
    steps[steps == scene3d.NO_ERROR] = np.nan
    np.testing.assert_allclose(
        steps * scene3d.ERROR_STEP_MM, 1e3 * error_m, atol=0.51 * scene3d.ERROR_STEP_MM
    )


def test_a_fine_map_is_thinned_for_the_view(result_folder, monkeypatch):
    monkeypatch.setattr(scene3d, "PIXELS", 1000)
    scene = scene3d.scene(results.load(result_folder), results.load(result_folder).scored()[0])
    assert all(np.prod(surface["shape"]) <= 1100 for surface in scene["surfaces"])


def test_many_captures_go_to_pages_of_their_own(tmp_path, monkeypatch, undrawn):
    folder = write_synthetic(
        tmp_path / "r", ("B", "F", "U"), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    monkeypatch.setattr(html, "ABREAST", 2)
    monkeypatch.setattr(html, "FIRST", 1)
    out = tmp_path / "out"
    (out / "pages").mkdir(parents=True)
    (out / "pages/007.html").write_text("of an earlier report")
    html.build(folder, out)
    assert [path.name for path in (out / "pages").iterdir()] == ["001.html"]
    first, further = parsed(out / "index.html"), parsed(out / "pages/001.html")
    assert "capture-B" in first.ids and not {"capture-F", "capture-U"} & set(first.ids)
    assert {"capture-F", "capture-U"} <= set(further.ids)
    assert '<a href="../index.html' in (out / "pages/001.html").read_text(encoding="utf-8")


def test_pages_are_the_same_from_one_process_and_from_two(tmp_path, monkeypatch):
    folder = write_synthetic(
        tmp_path / "r", tuple("BFU"), {"3fsk": METHODS["3fsk"]}, ("truth",), step_m=6e-3
    )
    monkeypatch.setattr(html, "ABREAST", 1)
    monkeypatch.setattr(html, "FIRST", 1)
    written = []
    for count in ("1", "2"):
        monkeypatch.setenv("HANDBENCH_WORKERS", count)
        html.build(folder, out := tmp_path / count)
        written.append(
            {file.relative_to(out): file.read_bytes() for file in sorted(out.rglob("*.html"))}
        )
    assert len(written[0]) == 3 and written[0] == written[1]
    assert {file.name for file in (out / "figures").glob("depth_*")} == {
        *("depth_B.pdf", "depth_B.png", "depth_F.png", "depth_U.png")  # of further pages PNG only
    }


def test_captures_on_pages():
    names = [results.CaptureFacts(name=str(i)) for i in range(1000)]
    assert [len(page) for page in html.pages(names)][:3] == [3, 12, 12]
    assert [capture for page in html.pages(names) for capture in page] == names
    assert [len(page) for page in html.pages(names[:12])] == [12]


def compared(**facts):
    defaults = {
        "metric": "mae_mm",
        "difference": 1.0,
        "low": 0.5,
        "high": 1.5,
        "unit": "mm",
        "effect": 0.8,
        "reference": "truth",
        "n_captures": 3,
        "n_blocks": 50,
        "treatment": "",
    }
    return {**defaults, **facts, "sentence": f"{facts['better']} / {facts['worse']}"}


@pytest.fixture
def tested(result_folder):
    """3-FSK is shown to beat narrowband and 2-FSK, not broadband."""
    pairs = (("narrowband", 1e-6), ("2fsk", 0.01), ("broadband", 0.2))
    lines = [compared(better="3fsk", worse=worse, p_corrected=p) for worse, p in pairs]
    return replace(results.load(result_folder), files={"comparisons": frame(COMPARISONS, lines)})


def test_verdicts_name_what_was_shown_and_nothing_else(tested):
    (verdict,) = sections.verdicts(tested)
    assert verdict.best == ("3-FSK", "Broadband") and verdict.shown == 2
    assert set(verdict.leading) == {"3fsk / narrowband", "3fsk / 2fsk"}
    assert [row[1] for row in verdict.table.rows] == ["< 0.001", "0.010", "0.20"]


def test_only_tested_figures_are_marked(tested, tmp_path):
    text = render(
        "index.html",
        **html._summary(tested, [], None),
        **html._captures(tested, (), tmp_path),
        parts=[],
        part=0,
        groups=[()],
    )
    marked = re.findall(r"★</span>&nbsp;([^<]+)</b>", text)
    rows = [tested.row("mae_mm", method, "truth").value for method in ("3fsk", "broadband")]
    assert [float(mark) for mark in marked] == pytest.approx(rows, abs=0.006)


def test_effects_and_failures_are_told(folder, tmp_path, undrawn):
    told = tmp_path / "told"
    shutil.copytree(folder, told)
    about = read_json(told / "result.json", "")
    rows = [
        {
            "effect": "noise",
            "on": True,
            "why": "<b>",
            "depth_mm": 0.25,
            "level_db": None,
            "seconds": 1.5,
        }
    ]
    about["captures"][0]["effects"] = rows
    about["failures"] = [{"capture": "X", "stage": "score", "message": "<b>no</b>"}]
    write_json(told / "result.json", about)
    html.build(told, tmp_path / "out")
    text = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert "<b>no" not in text and "X: score failed: &lt;b&gt;no" in text
    assert "1 of 1" in text and "0.250" in text


def test_three_captures_have_a_report_that_says_that_they_are_too_few(tmp_path, undrawn):
    """Nothing is tested, so no method has the best figure: as in the embedded benchmark of three
    poses."""
    methods = {name: METHODS[name] for name in ("2fsk", "3fsk")}
    folder = write_synthetic(tmp_path / "r", ("B", "F", "U"), methods, ("truth",), step_m=6e-3)
    figures = {"2fsk": np.array([6.0, 5.0, 7.0]), "3fsk": np.array([1.0, 1.1, 0.9])}
    results.write_tables(folder, comparisons=compare(figures, "truth"))
    html.build(folder, tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text("utf-8")
    assert "Too few captures for a test" in text and "has the best figure" not in text
    assert (
        "3fsk is ahead of 2fsk by 5.0 mm (MAE) on 3 captures: too few captures for a test" in text
    )


def test_captures_say_what_they_measure_and_those_of_the_precision_have_no_pictures(result_folder):
    result = results.load(result_folder)
    grid = sections.captures(result)
    assert {row[0]: row[2:4] for row in grid.rows} == {
        **dict.fromkeys("BFUVW", ("accuracy", "photogrammetry, truth")),
        **dict.fromkeys(("hand0", "hand1", "hand2"), ("precision", "–")),
    }
    assert (
        grid.caption
        == "Captures; those that only measure the precision are not scored and have no pictures"
    )
    scored = replace(result, about=result.about.model_copy(update={"captures": result.scored()}))
    assert sections.captures(scored).caption == "Captures"
    assert [capture.name for page in html.pages(result.scored()) for capture in page] == list(
        "BFUVW"
    )


def test_settings_that_captures_share_are_told_once(tested):
    config = {c: {"step_m": 0.001} for c in "BFVW"} | {"U": {"step_m": 0.002}}
    methods = tuple(m.model_copy(update={"config": config}) for m in tested.about.methods)
    result = replace(tested, about=tested.about.model_copy(update={"methods": methods}))
    assert sections.settings(result)[0] == (
        "2-FSK",
        [("B, F, V, W", {"step_m": 0.001}), ("U", {"step_m": 0.002})],
    )
