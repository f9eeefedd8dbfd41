"""The report in a browser: from a file, without a network, turned by keys and switched by
clicks."""

from __future__ import annotations

import io
from base64 import b64decode

import numpy as np
import pytest
from PIL import Image

from handbench.reports.page import html
from tests.reports.page.devtools import CHROMIUM, Browser
from tests.reports.page.layout import faults
from tests.reports.synthetic_result import METHODS, write_synthetic, write_synthetic_tradeoff

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium: the report was NOT looked at in a browser (Debian's package: chromium)",
)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A report of two captures with a trade-off."""
    base = tmp_path_factory.mktemp("browser")
    methods = {name: METHODS[name] for name in ("3fsk", "2fsk")}
    folder = write_synthetic(base / "table", ("B", "F"), methods, ("photogrammetry",))
    return html.build(folder, base / "report", write_synthetic_tradeoff(base / "sweep"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


@pytest.fixture
def opened(browser, page):
    """The report at 1280 pixels, with the 3-D view in sight."""
    browser.open(page)
    browser.run("document.querySelector('canvas').scrollIntoView({block: 'center'})")
    browser.settle()
    return browser


def pixels(browser):
    """The view's pixels [rows, columns, 4]."""
    uri = browser.run("document.querySelector('.viewer canvas').toDataURL()")
    with Image.open(io.BytesIO(b64decode(uri.split(",")[1]))) as image:
        return np.asarray(image.convert("RGBA")).astype(int)


def changed(before, after):
    """Share of the pixels that differ."""
    return np.mean(np.abs(before - after).max(axis=-1) > 8)


def choose(browser, name, value):
    """Click the control of that name and value."""
    browser.run(f"document.querySelector('.viewer [name={name}][value=\"{value}\"]').click()")
    browser.settle()


def test_nothing_is_fetched_and_nothing_complains(opened):
    def seen(method):
        return [e["params"] for e in opened.events if e["method"].startswith(method)]

    requests = [asked["request"]["url"] for asked in seen("Network.requestWillBeSent")]
    [page] = [url for url in requests if not url.startswith("data:")]
    assert page.startswith("file:")
    assert seen("Runtime.exception") == seen("Runtime.console") == []
    assert [e for e in seen("Log.entryAdded") if e["entry"]["level"] == "error"] == []


def test_the_view_shows_a_hand_and_answers_to_keys(opened):
    """Something of a hand's share of the canvas, neither flat nor a silhouette; the still picture
    gives way to it."""
    opened.run("document.querySelector('.viewer canvas').focus()")
    start = pixels(opened)
    covered = start[..., 3] > 128
    assert 0.05 < covered.mean() < 0.6 and start[covered][:, 0].std() > 15
    assert opened.run("getComputedStyle(document.querySelector('.still')).display") == "none"
    opened.press("ArrowLeft")
    turned = pixels(opened)
    opened.press("+")
    nearer = pixels(opened)
    opened.press("Home")
    assert changed(start, turned) > 0.01 and changed(turned, nearer) > 0.01
    assert (nearer[..., 3] > 0).sum() > (turned[..., 3] > 0).sum()
    assert np.array_equal(pixels(opened), start)


def test_methods_captures_and_colours_are_switched(opened):
    start, status = pixels(opened), "document.querySelector('.status').textContent"
    assert opened.run(status).startswith("B: 3-FSK, ") and "MAE" in opened.run(status)
    choose(opened, "method", "2fsk")
    other = pixels(opened)
    assert opened.run(status).startswith("B: 2-FSK, ") and changed(start, other) > 0.002
    choose(opened, "colour", "depth")
    assert changed(other, pixels(opened)) > 0.02
    assert opened.run("document.querySelector('.legend .what').textContent") == "depth z in mm"
    choose(opened, "reference", "1")
    assert (pixels(opened)[..., 3] > 0).mean() < 0.9 * (other[..., 3] > 0).mean()
    opened.run(
        "{const s = document.querySelector('select'); s.selectedIndex = 1;"
        "s.dispatchEvent(new Event('change', {bubbles: true}))}"
    )
    assert opened.run(status).startswith("F: 2-FSK, ")


SCREENS = [(width, "", scheme) for width in (400, 800, 1280, 1920) for scheme in ("light", "dark")]


@pytest.mark.parametrize("unfolded", [False, True])
def test_no_text_is_cut_covered_or_faint(opened, unfolded):
    """On screens from a telephone's to a wide one's, and on paper (A4 across)."""
    if unfolded:
        opened.run("document.querySelectorAll('details').forEach(of => of.open = true)")
    for width, media, scheme in [*SCREENS, (1032, "print", "light")]:
        assert faults(opened, width, media, scheme) == [], (width, media, scheme)


@pytest.mark.parametrize(
    ("style", "fault"),
    [
        ("position: absolute; top: 0; left: 0; width: 400px", "covers"),
        ("margin-left: -300px; width: 200px", "is cut"),
        ("color: #999", "has a contrast of 2.85"),
        ("min-width: 3000px", "px wide"),
    ],
)
def test_a_fault_of_the_layout_is_found(opened, style, fault):
    opened.run(f"document.querySelector('.leads').style.cssText = {style!r}")
    assert any(fault in found for found in faults(opened, 1280))


def test_the_report_of_a_sphere_has_its_words_and_fits(browser, small_result, tmp_path):
    browser.open(html.build(small_result, tmp_path / "report"))
    assert [faults(browser, width) for width in (400, 1280)] == [[], []]
    text = browser.run("document.body.innerText").lower()
    assert "1 capture: no test" in text and "hand " not in text and "paper's" not in text
    headings = browser.run("[...document.querySelectorAll('h2, h3')].map(of => of.textContent)")
    assert len(headings) == len(set(headings))
