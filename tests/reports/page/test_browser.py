"""The report in a browser, from a file: nothing is cut, covered or faint at several widths, and the
3-D view draws what is chosen."""

from __future__ import annotations

import html as markup
import json
import re
import shutil
import subprocess

import pytest

from handbench.reports.page import html
from tests.reports.synthetic_result import METHODS, write_synthetic

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium: the report was NOT looked at in a browser (Debian's package: chromium)",
)
SWITCHES = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WIDTHS = (400, 800, 1280, 1920)
# Leaf texts with their rectangles; a text in a region that scrolls by itself may go beyond its
# edge, the main table may not.
FAULTS = """function layoutFaults() {
const faults = [], page = document.documentElement, wide = page.clientWidth;
if (page.scrollWidth > wide) faults.push(`the page is ${page.scrollWidth} px wide, not ${wide}`);
const main = document.querySelector('table.main');
if (main && main.scrollWidth > main.parentElement.clientWidth + 1)
  faults.push('the main table scrolls');
const luminance = c => { const [r, g, b] = c.map(v => (v /= 255) <= .04045 ? v / 12.92
  : ((v + .055) / 1.055) ** 2.4); return .2126 * r + .7152 * g + .0722 * b; };
const parse = text => text.match(/[\\d.]+/g).map(Number);
const ground = e => { for (; e; e = e.parentElement) {
  const c = parse(getComputedStyle(e).backgroundColor);
  if (c.length < 4 || c[3] > 0) return c.slice(0, 3); }
  return matchMedia('(prefers-color-scheme: dark)').matches && !matchMedia('print').matches
    ? [4, 4, 4] : [255, 255, 255]; };
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), boxes = [];
const range = document.createRange();
while (walker.nextNode()) {
  const text = walker.currentNode, of = text.parentElement;
  if (!text.data.trim() || of.closest('script, style, option, .skip')) continue;
  if (!of.checkVisibility({contentVisibilityAuto: true, visibilityProperty: true})) continue;
  const said = JSON.stringify(text.data.trim().slice(0, 40)), scrolls = of.closest('.scroll, pre');
  const style = getComputedStyle(of), [a, b] = [parse(style.color).slice(0, 3), ground(of)]
    .map(luminance).sort((x, y) => y - x), ratio = (a + .05) / (b + .05);
  if (ratio < 4.5) faults.push(`${said} has a contrast of ${ratio.toFixed(2)}`);
  range.selectNodeContents(text);
  for (const box of range.getClientRects()) {
    if (box.width < 1) continue;
    const limit = scrolls ? scrolls.getBoundingClientRect() : {left: 0, right: wide};
    const beyond = box.right > limit.right + 1 || box.left < limit.left - 1;
    if (beyond && !(scrolls && scrolls.scrollWidth > scrolls.clientWidth))
      faults.push(`${said} is cut`);
    if (!beyond) boxes.push([box, text, said]);
  }
}
boxes.sort((p, q) => p[0].top - q[0].top);
boxes.forEach(([p, text, said], i) => {
  for (let k = i + 1; k < boxes.length && boxes[k][0].top < p.bottom - 4; k++) {
    const [q, other, too] = boxes[k];
    if (other !== text && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 2
        && Math.min(p.bottom, q.bottom) - q.top > 4) faults.push(`${said} covers ${too}`);
  }
});
return faults;
}"""
# Each page tells the one around it what it has found, folded and with all of it unfolded.
TELL = """addEventListener('load', async () => {
const pause = () => new Promise(done => setTimeout(done, 200));
const broken = location.search === '?broken', canvas = document.querySelector('.viewer canvas');
if (broken) document.querySelector('.leads').style.cssText =
  'color: #999; margin-left: -300px; min-width: 3000px';
const faults = layoutFaults();
canvas.scrollIntoView();
await pause();
const before = canvas.toDataURL();
document.querySelector('.viewer [name=method][value="3fsk-fast"]').click();
await pause();
for (let n = 0; location.search === '?view' && n < 100 && before === canvas.toDataURL(); n++)
  await pause();
const drawn = before !== canvas.toDataURL(), status = document.querySelector('.status').textContent;
document.querySelectorAll('details').forEach(of => of.open = true);
await pause();
faults.push(...layoutFaults());
parent.postMessage({page: location.search, faults, drawn, status}, '*');
});"""
AROUND = """<pre></pre><script>onmessage = e =>
document.querySelector('pre').append(JSON.stringify(e.data) + '\\n')</script>"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What a browser finds in a report of two captures by two settings of a method: page → its
    findings."""
    base = tmp_path_factory.mktemp("browser")
    methods = {"3fsk": METHODS["3fsk"], "3fsk-fast": ("3-FSK, fast", *METHODS["2fsk"][1:])}
    folder = write_synthetic(base / "table", ("B", "F"), methods, ("photogrammetry",))
    page = html.build(folder, base / "report")
    text = re.sub("<meta http-equiv[^>]*>", "", page.read_text("utf-8"))  # forbids other scripts
    script = f"<script>{FAULTS}\n{TELL}</script></body>"
    (base / "page.html").write_text(text.replace("</body>", script), "utf-8")
    # a page that the others move out of the window does not draw its view
    return look(base, [*map(str, WIDTHS), "broken"]) | look(base, ["view"])


def look(base, pages):
    """What a browser finds in frames of these names, of 1280 pixels or as many as the name says."""
    widths = [name if name.isdigit() else 1280 for name in pages]
    frame = '<iframe src="page.html?{}" width="{}" height="900"></iframe>'
    frames = map(frame.format, pages, widths)
    (base / "around.html").write_text(AROUND + "".join(frames), "utf-8")
    uri = (base / "around.html").as_uri()
    given = [CHROMIUM, *SWITCHES, "--virtual-time-budget=60000", "--dump-dom", uri]
    found = subprocess.run(given, capture_output=True, check=True, timeout=600, text=True).stdout
    lines = markup.unescape(found.partition("<pre>")[2].partition("</pre>")[0]).splitlines()
    return {line["page"][1:]: line for line in map(json.loads, lines)}


@pytest.mark.parametrize("width", WIDTHS)
def test_no_text_is_cut_covered_or_faint(seen, width):
    assert seen[str(width)]["faults"] == []


def test_faults_of_the_layout_are_found(seen):
    faults = " ".join(seen["broken"]["faults"])
    assert all(fault in faults for fault in ("is cut", "has a contrast of 2.85", "px wide"))


def test_the_view_in_3d_draws_the_method_that_is_chosen(seen):
    assert seen["view"]["drawn"] and seen["view"]["status"].startswith("B: 3-FSK, fast, ")
