"""The whole report, and its pictures."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from PIL import Image

from handbench.bench.evaluation.paired import compare
from handbench.bench.results.about import MethodFacts
from handbench.bench.results.maps import write_frames
from handbench.bench.results.result_folder import load
from handbench.reports.figures.depth_maps import panels
from handbench.reports.figures.layers import ERRORS
from handbench.reports.figures.style import STYLE
from handbench.reports.page import html, rendering, scene3d, sections, several, summary
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json
from tests.reports.figures.test_film import sequence
from tests.reports.synthetic_result import METHODS, compared, write_synthetic

SCRIPT = "<script>alert(1)<&script>"  # as near to a closing tag as a file name gets


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One capture with a hostile name, two methods with hostile titles."""
    folder = write_synthetic(
        tmp_path_factory.mktemp("hostile") / "r",
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
    stems = ("front_mae_mm", *own, "error_distribution", "repeats")
    expected = {"table.md", "table.tex", "column.tex", "table.csv", "index.html"}
    expected |= {f"figures/{stem}{suffix}" for stem in stems for suffix in (".png", ".pdf")}
    assert {
        str(path.relative_to(report)) for path in report.rglob("*") if path.is_file()
    } == expected
    assert all((report / name).stat().st_size > 500 for name in expected)


class Tags(HTMLParser):
    """Collects ids, and the tags that are open."""

    def __init__(self):
        super().__init__()
        self.ids, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in ("img", "meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def ids(file):
    """The ids of a page, whose tags are all closed."""
    tags = Tags()
    tags.feed(file.read_text(encoding="utf-8"))
    assert tags.open == [] and len(tags.ids) == len(set(tags.ids))
    return tags.ids


def images(text):
    """Source and description of each picture of a page."""
    return re.findall(r'<img [^>]*src="([^"]*)"[^>]*alt="([^"]*)"', text)


def test_the_page_is_self_contained_and_escaped(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    assert ids(report / "index.html")
    assert not re.search(r"<(i|link|iframe|object)\b|(src|href)=\"?(http|/|\.)", text)
    assert len(images(text)) == text.count("<img") == 7
    for source, description in images(text):
        assert source.startswith("data:image/webp;base64,") and len(description) > 40
    assert text.count('href="figures/depth_%3Cscript') == 2  # PDF and PNG


def test_the_policy_lets_in_our_style_and_script_alone(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    [policy] = re.findall(r'content="(default-src[^"]*)"', text)
    assert policy.startswith("default-src 'none'; img-src data:;") and "unsafe" not in policy
    style, script = re.findall(r"<(style|script)>(.*?)</\1>", text, re.DOTALL)
    for kind, content in (style, script):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy


@pytest.fixture
def undrawn(monkeypatch):
    """A report without pictures, where words are looked at."""
    monkeypatch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])


def test_building_again_replaces_and_leaves_strangers_alone(folder, tmp_path, undrawn):
    before = html.build(folder, report := tmp_path / "report").read_bytes()
    (report / "notes.txt").write_text("mine")
    assert html.build(folder, report) == report / "index.html"
    assert (report / "notes.txt").read_text() == "mine"
    assert (report / "index.html").read_bytes() == before  # same data, same bytes


def test_several_results_have_one_page_with_a_row_for_each_method(folder, tmp_path, undrawn):
    page = several.build([folder, folder], tmp_path / "out")
    text = page.read_text(encoding="utf-8")
    assert len(images(text)) == 4
    hrefs = re.findall(r'href="(report[^"]*)"', text)
    assert hrefs == 2 * ["report-1/index.html"] + 2 * ["report-2/index.html"]
    assert all((tmp_path / "out" / href).is_file() for href in hrefs)


def test_never_writes_over_the_result(folder):
    before = (folder / "table.csv").read_bytes()
    with pytest.raises(HandbenchError, match="result folder itself"):
        html.build(folder, folder)
    assert (folder / "table.csv").read_bytes() == before


def test_depth_maps_share_scale_and_axes_seen_from_the_array(result_folder):
    result = load(result_folder)
    with matplotlib.rc_context(STYLE):
        drawn = {picture.stem: picture for picture in panels(result, result.scored()[0])}
    figure = drawn["depth_B"].figure
    shown = [axis for axis in figure.axes if axis.images and axis.axison]
    depths, errors = shown[:5], shown[5:]
    assert len(errors) == 4 and all("MAE " in axis.get_title() for axis in errors)
    assert len({axis.images[0].norm for axis in depths}) == 1
    assert {axis.images[0].norm.vmax for axis in errors} == {50}  # of every capture
    assert len({(axis.get_xlim(), axis.get_ylim()) for axis in shown}) == 1
    left, right = shown[0].get_xlim()
    assert left > right  # x grows to the left
    assert [text.get_text()[:7] for text in figure.texts[:2]] == ["x in mm", "y in mm"]


@pytest.mark.slow
def test_pages_are_the_same_from_one_process_and_from_two(tmp_path, monkeypatch):
    """Captures that do not fit on the first page go to pages of their own; of an earlier report
    none stays."""
    methods = {"3fsk": METHODS["3fsk"]}
    folder = write_synthetic(tmp_path / "r", ("B", "F", "U"), methods, ("truth",), step_m=6e-3)
    monkeypatch.setattr(html, "ABREAST", 1)
    written = []
    for count in ("1", "2"):
        monkeypatch.setenv("HANDBENCH_WORKERS", count)
        out = tmp_path / count
        (out / "pages").mkdir(parents=True)
        (out / "pages/007.html").write_text("of an earlier report")
        html.build(folder, out)
        files = sorted(out.rglob("*.html"))
        written.append({file.relative_to(out): file.read_bytes() for file in files})
    assert len(written[0]) == 3 and written[0] == written[1]
    # of further pages PNG only
    figures = {"depth_B.pdf", "depth_B.png", "depth_F.png", "depth_U.png"}
    assert {file.name for file in (out / "figures").glob("depth_*")} == figures
    first, further = ids(out / "index.html"), ids(out / "pages/001.html")
    assert "capture-B" in first and "capture-F" not in first
    assert "capture-F" in further
    assert '<a href="../index.html' in (out / "pages/001.html").read_text(encoding="utf-8")


def test_effects_and_failures_are_shown(folder, tmp_path, undrawn):
    """The capture's reference failed, so it has no table."""
    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    about = read_json(changed / "result.json", "")
    about["captures"][0]["references"] = []
    noise = {"effect": "noise", "on": True, "why": "<b>", "depth_mm": 0.25, "seconds": 1.5}
    about["captures"][0]["effects"] = [noise | {"level_db": None}]
    about["failures"] = [{"capture": "X", "stage": "score", "message": "<b>no</b>"}]
    about["protocol"]["compared"] = ["mae_mm"]
    write_json(changed / "result.json", about)
    text = html.build(changed, tmp_path / "out").read_text(encoding="utf-8")
    assert "<b>no" not in text and "X: score failed: &lt;b&gt;no" in text
    assert "1 of 1" in text and "0.25" in text and "Every pair of methods" in text
    assert "★ " not in text  # nothing is tested, so no method has the best figure


def test_the_best_method_the_registration_and_a_film_are_shown(folder, tmp_path, undrawn):
    """Figures of ten captures, of which 3-FSK's are smaller on each; residuals of a calibration
    in millimetres; a sequence of three frames."""
    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    figures = {"2fsk": 6 + np.linspace(0, 1, 10), "3fsk": 1 + np.linspace(0, 0.5, 10)}
    write_frames(changed, SCRIPT, "3fsk", sequence(3))
    about = read_json(changed / "result.json", "")
    about["facts"] |= {"registration_residuals_mm": [0.2, 0.4]}
    about["facts"] |= {"registration_error_at_hand_mm": 0.8}
    write_json(changed / "result.json", about)
    result = compared(load(changed), compare(figures, "truth"))
    assert "<b>3-FSK</b>" in summary.leads(result)["Best"]
    assert ["0.20", "0.40"] in sections.uncertainty(result)[0].values()
    film = html._film(result, result.scored()[0], tmp_path)
    [file] = tmp_path.glob("*.gif")
    assert film.uri.endswith(base64.b64encode(file.read_bytes()).decode())
    with Image.open(file) as pictures:
        assert pictures.n_frames == 3 and pictures.size == (film.width, film.height)


@pytest.mark.parametrize(
    ("config", "text"),
    [
        ({"tones_hz": [82e9, 81.8e9], "tolerance": 1e-5}, "82, 81.8 GHz"),
        ({"tones_hz": [82e9, 81.8e9, 72e9]}, "82, 81.8, 72 GHz"),
        (
            {"tones_hz": {"start_hz": 72e9, "stop_hz": 82e9, "count": 128}},
            "128 tones, 72 to 82 GHz",
        ),
        ({"mine": "none"}, ""),
    ],
)
def test_the_tones_of_a_method_are_named(config, text):
    method = MethodFacts(name="mine", title="mine", config={"B": config, "F": config})
    assert summary.tones_text(method) == text


def test_what_turns_in_3d_is_what_was_measured(result_folder):
    """Depths to half a step, errors in their colours; every so many pixels of the map."""
    result = load(result_folder)
    scene = json.loads(json.dumps(scene3d.scene(result, result.scored()[1])))
    surface = next(s for s in scene["surfaces"] if s["name"] == "3fsk")

    def decoded(text, kind):
        return np.frombuffer(base64.b64decode(text), kind)

    seen = np.unpackbits(decoded(surface["seen"], "u1"))[: np.prod(surface["shape"])] == 1
    measured = result.surface("F", "3fsk")
    places = [
        np.searchsorted(1e3 * axis_m + 0.5, np.linspace(*surface[f"{side}_mm"], n))
        for side, n, axis_m in zip(
            "yx", surface["shape"], (measured.y_m, measured.x_m), strict=True
        )
    ]
    z_mm, error_mm = (
        1e3 * of_m[np.ix_(*places)].ravel()
        for of_m in (measured.z_m, result.errors("F", "3fsk", "truth").error_m)
    )
    assert surface["pixels"] == seen.sum() == np.isfinite(measured.z_m).sum()
    assert np.array_equal(seen, np.isfinite(z_mm))
    found_mm = scene["low_mm"] + scene["step_mm"] * decoded(surface["z"], "<u2")
    np.testing.assert_allclose(found_mm, z_mm[seen], atol=0.51 * scene["step_mm"])
    numbers = decoded(surface["errors"]["truth"]["colours"], "u1")
    assert np.array_equal(numbers == 0, np.isnan(error_mm[seen]))
    colours = np.array([(0, 0, 0), *map(to_rgb, scene3d.scales()["error"])])[numbers]
    expected = colormaps[ERRORS.colours](ERRORS.norm(error_mm[seen]))[:, :3]
    shown = numbers > 0
    np.testing.assert_allclose(colours[shown], expected[shown], atol=0.04)
