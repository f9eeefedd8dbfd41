"""The whole report, and its pictures."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from PIL import Image

from handbench.bench.evaluation.paired import compare
from handbench.bench.evaluation.tables import COMPARISONS, conform
from handbench.bench.results.result_folder import load
from handbench.reports.figures.depth_maps import panels
from handbench.reports.figures.layers import ERRORS
from handbench.reports.figures.style import STYLE
from handbench.reports.page import html, rendering, scene3d, sections, summary
from handbench.support.files import read_json, write_json, write_text
from tests.golden_files import RESULT, renamed
from tests.refusals import refuse_command

SCRIPT = "<script>alert(1)<&script>"  # as near to a closing tag as a file name gets


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The report of the golden result whose one capture with maps has a hostile name."""
    folder = renamed(tmp_path_factory.mktemp("hostile") / "r", {"B": SCRIPT})
    facts = read_json(folder / "result.json", "")
    facts["captures"][1]["measures"] = ["precision"]
    facts["machine"]["host"] = "\x1b\x9b"  # which a terminal would obey
    write_json(folder / "result.json", facts)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(rendering.PAGE, "savefig.dpi", 50)  # for speed
        patch.setitem(rendering.COLUMN, "pdf.fonttype", 3)  # whole fonts are not cut
        return html.build(folder, folder.parent / "report").parent


def test_every_file_is_there_and_nothing_else(report):
    stems = {f"depth_{SCRIPT}", f"error_{SCRIPT}__truth"}
    stems |= {"front_mae_mm", "error_captures", "error_distribution", "repeats"}
    expected = {"table.md", "table.tex", "column.tex", "table.csv", "index.html"}
    expected |= {"comparisons.md", "comparisons.tex"}
    expected |= {f"figures/{stem}{suffix}" for stem in stems for suffix in (".png", ".pdf")}
    files = {str(path.relative_to(report)) for path in report.rglob("*") if path.is_file()}
    assert files == expected
    assert all((report / name).stat().st_size > 500 for name in expected)


def images(text):
    """Source and description of each picture of a page."""
    return re.findall(r'<img [^>]*src="([^"]*)"[^>]*alt="([^"]*)"', text)


def test_the_page_is_self_contained_and_escaped(report):
    text = (report / "index.html").read_text(encoding="utf-8")
    assert "\ufffd\ufffd" in text and "\x1b" not in text
    assert not re.search(r"<(i|b>50|link|iframe|object)\b|(src|href)=\"?(http|/|\.)", text)
    assert len(images(text)) == text.count("<img") == 8
    for source, description in images(text):
        assert source.startswith("data:image/webp;base64,") and len(description) > 40
    assert text.count('href="figures/depth_%3Cscript') == 2  # PDF and PNG
    [policy] = re.findall(r'content="(default-src[^"]*)"', text)
    assert policy.startswith("default-src 'none'; img-src data:;") and "unsafe" not in policy
    style, script = re.findall(r"<(style|script)>(.*?)</\1>", text, re.DOTALL)
    for kind, content in (style, script):  # ours alone
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """The page of the golden result and itself, without pictures of their figures."""
    out = tmp_path_factory.mktemp("reports")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HANDBENCH_WORKERS", "1")
        patch.setattr(rendering, "images", lambda pictures, folder, paper=True: [])
        patch.setattr(html, "_film", lambda *_: None)
        return html.build_several([RESULT, RESULT], out)


def test_a_report_shows_effects_and_failures(reports):
    out = reports.parent
    text = (out / "report-1" / "index.html").read_text(encoding="utf-8")
    assert "U: score failed: &lt;b&gt;no" in text
    assert "1 of 1" in text and "0.25" in text and "Every pair of methods" in text
    assert "★ " not in text  # nothing is tested, so no method has the best figure
    assert (out / "report-2" / "index.html").read_text(encoding="utf-8") == text


def test_several_results_have_one_page_with_a_row_for_each_method(reports):
    text = reports.read_text(encoding="utf-8")
    assert len(images(text)) == 2 * 4 * 2  # results, methods, captures
    hrefs = re.findall(r'href="(report[^"]*)"', text)
    assert hrefs == 4 * ["report-1/index.html"] + 4 * ["report-2/index.html"]


def test_replaces_no_file_of_others(tmp_path, reports):
    folder = shutil.copytree(RESULT, tmp_path / "result")
    refuse_command(["report", str(folder), "-o", str(folder)], str(folder))
    assert (folder / "table.csv").read_bytes() == (RESULT / "table.csv").read_bytes()
    site = shutil.copytree(reports.parent, tmp_path / "site")
    for name in ("index.html", "report-1/notes.txt"):
        write_text(site / name, "mine")
        refuse_command(["report", str(RESULT), "-o", str(site)], name)
        assert (site / name).read_text() == "mine"


def test_depth_maps_share_scale_and_axes_seen_from_the_array():
    result = load(RESULT)
    with matplotlib.rc_context(STYLE):
        figure, _ = (picture.figure for picture in panels(result, result.scored()[0]))
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
    monkeypatch.setattr(html, "ABREAST", 1)
    monkeypatch.setattr(html.plots, "overview", lambda result: ())  # drawn in this process alone
    written = []
    for count in ("1", "2"):
        monkeypatch.setenv("HANDBENCH_WORKERS", count)
        out = tmp_path / "out"
        html.build(RESULT, out)
        files = sorted(out.rglob("*.html"))
        written.append({str(file.relative_to(out)): file.read_text("utf-8") for file in files})
        write_text(out / "pages/007.html", "of an earlier report")
    assert written[0] == written[1]
    first, further = written[0]["index.html"], written[0]["pages/001.html"]
    assert len(written[0]) == 2
    assert 'id="capture-B"' in first and 'id="capture-F"' not in first
    assert 'id="capture-F"' in further and '<a href="../index.html' in further
    # of further pages PNG only
    figures = {"depth_B.pdf", "depth_B.png", "depth_F.png"}
    assert {file.name for file in (out / "figures").glob("depth_*")} == figures


def test_the_best_method_the_registration_and_a_film_are_shown(tmp_path):
    """Figures of ten captures, of which 3-FSK's are smaller on each."""
    figures = {"2fsk": 6 + np.linspace(0, 1, 10), "3fsk": 1 + np.linspace(0, 0.5, 10)}
    result = replace(load(RESULT))
    result.__dict__["comparisons"] = conform(compare(figures, "photogrammetry"), COMPARISONS)
    assert "<b>3-FSK</b>" in summary.leads(result)["Best"]
    assert ["0.20", "0.40"] in sections.uncertainty(result)[0].values()
    film = html._film(result, result.scored()[1], tmp_path)
    [file] = tmp_path.glob("*.gif")
    assert film.uri.endswith(base64.b64encode(file.read_bytes()).decode())
    with Image.open(file) as pictures:
        assert pictures.n_frames == 3 and pictures.size == (film.width, film.height)


def test_what_turns_in_3d_is_what_was_measured():
    """Depths to half a step, errors in their colours; every so many pixels of the map."""
    result = load(RESULT)
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
    np.testing.assert_array_equal(seen, np.isfinite(z_mm))
    shown_mm = scene["low_mm"] + scene["step_mm"] * decoded(surface["z"], "<u2")
    np.testing.assert_allclose(shown_mm, z_mm[seen], atol=0.51 * scene["step_mm"])
    numbers = decoded(surface["errors"]["truth"]["colours"], "u1")
    np.testing.assert_array_equal(numbers == 0, np.isnan(error_mm[seen]))
    colours = np.array([(0, 0, 0), *map(to_rgb, scene3d.scales()["error"])])[numbers]
    expected = colormaps[ERRORS.colours](ERRORS.norm(error_mm[seen]))[:, :3]
    shown = numbers > 0
    np.testing.assert_allclose(colours[shown], expected[shown], atol=0.04)
