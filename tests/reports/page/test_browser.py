"""Reports in a browser, from files: nothing is cut, covered or faint at several widths, in light,
dark and print, and the 3-D view draws what is chosen."""

from __future__ import annotations

import html as markup
import json
import re
import shutil
import subprocess

import pytest

from handbench.reports.page import html, rendering
from tests.golden_files import RESULT, renamed

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium: no report was looked at in a browser (Debian's package: chromium)",
)
SWITCHES = ("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
STRANGERS = {"B": "left hand of subject 17, second session, thumb abducted", "F": "Ωß_%$#&{}^~"}
PAGES = {"golden": "golden/index.html", "strangers": "strangers/index.html"}
PAGES["further"] = "strangers/pages/001.html"
WIDTHS = {400: "light", 1280: "dark"}
PRINTED = 1032  # CSS pixels of a sheet of A4, landscape, without its margins
PICTURE = rendering.Image(
    uri="data:image/gif;base64,R0lGODlhAQABAAAAACw=",
    width=798,
    height=400,
    alt="grey",
    caption=30 * "words ",
    stem="depth_B",
    kinds=("pdf", "png"),
)
# Leaf texts with their rectangles and their nearest box that cuts or scrolls; a text may go beyond
# a box that scrolls, except in the main table.
FAULTS = """function layoutFaults() {
const faults = [], boxes = [], page = document.documentElement, wide = page.clientWidth;
if (page.scrollWidth > wide) faults.push(`the page is ${page.scrollWidth} px wide, not ${wide}`);
const main = document.querySelector('.main table');
if (main && main.scrollWidth > main.parentElement.clientWidth + 1)
  faults.push('the main table scrolls');
const luminance = c => { const [r, g, b] = c.map(v => (v /= 255) <= .04045 ? v / 12.92
  : ((v + .055) / 1.055) ** 2.4); return .2126 * r + .7152 * g + .0722 * b; };
const parse = text => text.match(/[\\d.]+/g).map(Number);
page.style.backgroundColor = 'Canvas';
// of an element: its background's colour, its nearest box that cuts or scrolls, and its opacity
const known = new Map([[null, {region: null, opacity: 1}]]);
const around = e => {
  if (!known.has(e)) {
    const style = getComputedStyle(e), outer = around(e.parentElement);
    const ground = parse(style.backgroundColor);
    known.set(e, {
      ground: (ground[3] ?? 1) > 0 ? ground.slice(0, 3) : outer.ground,
      region: style.overflowX === 'visible' ? outer.region
        : {box: e.getBoundingClientRect(), scrolls: e.scrollWidth > e.clientWidth
           && /auto|scroll/.test(style.overflowX)},
      opacity: outer.opacity * style.opacity,
    });
  }
  return known.get(e);
};
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
const range = document.createRange();
while (walker.nextNode()) {
  const text = walker.currentNode, of = text.parentElement;
  if (!text.data.trim() || of.closest('script, style, option')) continue;
  if (!of.checkVisibility({contentVisibilityAuto: true, visibilityProperty: true})) continue;
  const said = JSON.stringify(text.data.trim().slice(0, 40));
  const {ground, region, opacity} = around(of);
  const [a, b] = [parse(getComputedStyle(of).color).slice(0, 3), ground]
    .map(luminance).sort((x, y) => y - x), ratio = (a + .05) / (b + .05);
  const limit = region ? region.box : {left: 0, right: wide};
  range.selectNodeContents(text);
  for (const box of range.getClientRects()) {
    if (box.width < 1 || box.right < 0) continue;  // for screen readers alone
    if (ratio < 4.5 || opacity < 1) faults.push(`${said} has a contrast of ${ratio.toFixed(2)}`);
    const beyond = box.right > limit.right + 1 || box.left < limit.left - 1;
    if (beyond && !region?.scrolls) faults.push(`${said} is cut`);
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
return [...new Set(faults)];
}"""
# Each page tells the one around it its faults, with all of it unfolded. A page called "print" has
# the rules for print, and stays folded.
TELL = """addEventListener('load', async () => {
const pause = () => new Promise(done => setTimeout(done, 200)), kind = location.search.slice(1);
if (kind === 'print') for (const rule of document.styleSheets[0].cssRules)
  if (rule.media?.mediaText === 'print') rule.media.mediaText = 'all';
const view = {};
if (kind === 'view') {
  const canvas = document.querySelector('.viewer canvas');
  canvas.scrollIntoView();
  await pause();
  const before = canvas.toDataURL();
  document.querySelector('.viewer [name=method][value=joint]').click();
  for (let n = 0; n < 100 && before === canvas.toDataURL(); n++) await pause();
  view.drawn = before !== canvas.toDataURL();
  view.dark = matchMedia('(prefers-color-scheme: dark)').matches;
  view.status = document.querySelector('.viewer .status').textContent;
}
if (kind !== 'print') document.querySelectorAll('details').forEach(of => of.open = true);
parent.postMessage({faults: layoutFaults(), ...view}, '*');
});"""
# Looks at one page after the other.
AROUND = """<pre></pre><script>(async () => {
for (const [name, address, width, scheme] of LOOKS) {
  const frame = document.createElement('iframe');
  Object.assign(frame, {src: address, width, height: 900});
  frame.style.colorScheme = scheme;
  const told = new Promise(done => onmessage = e => done(e.data));
  document.body.append(frame);
  document.querySelector('pre').append(JSON.stringify({name, ...await told}) + '\\n');
  frame.remove();
}
})()</script>"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What a browser finds: name of the look → its findings."""
    base = tmp_path_factory.mktemp("browser")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HANDBENCH_WORKERS", "1")
        patch.setattr(rendering, "images", lambda draw, folder, paper=True: [PICTURE])
        patch.setattr(html, "_film", lambda *_: PICTURE)
        html.build(RESULT, base / "golden")
        patch.setattr(html, "ABREAST", 1)
        html.build(renamed(base / "result", STRANGERS), base / "strangers")
    for path in PAGES.values():
        text = re.sub("<meta http-equiv[^>]*>", "", (base / path).read_text("utf-8"))
        script = f"<script>{FAULTS}\n{TELL}</script></body>"  # which the page's policy forbids
        (base / path).write_text(text.replace("</body>", script), "utf-8")
    looks = [("view", f"{PAGES['golden']}?view", 1280, "dark")]
    for name, path in PAGES.items():
        looks += [(f"{name} {width}", path, width, scheme) for width, scheme in WIDTHS.items()]
        looks += [(f"{name} print", f"{path}?print", PRINTED, "light")]
    (base / "around.html").write_text(AROUND.replace("LOOKS", json.dumps(looks)), "utf-8")
    command = [CHROMIUM, *SWITCHES, "--virtual-time-budget=600000", "--dump-dom"]
    command += [(base / "around.html").as_uri()]
    found = subprocess.run(command, capture_output=True, check=True, timeout=600, text=True).stdout
    lines = markup.unescape(found.partition("<pre>")[2].partition("</pre>")[0]).splitlines()
    findings = {line["name"]: line for line in map(json.loads, lines)}
    assert len(findings) == len(looks) and findings["view"]["dark"]
    return findings


@pytest.mark.parametrize("page", PAGES)
def test_no_text_is_cut_covered_or_faint(seen, page):
    faults = {look: of["faults"] for look, of in seen.items() if look.startswith(f"{page} ")}
    assert not any(faults.values()), faults


def test_the_view_in_3d_draws_the_method_that_is_chosen(seen):
    assert seen["view"]["drawn"] and seen["view"]["status"].startswith("B: joint ")
