"""What is wrong with the layout of an open page: text that is cut, covered or too faint, and a page
that scrolls sideways."""

from __future__ import annotations

from tests.reports.page.devtools import Browser

# Leaf texts with their rectangles; a text in a region that scrolls by itself may go beyond its
# edge, the main table may not.
FAULTS = """(() => {
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
})()"""


def faults(browser: Browser, width: int, media: str = "", scheme: str = "light") -> list[str]:
    """The faults of the open page at a width in CSS pixels, on a screen or, with media "print", on
    paper."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.call("Emulation.setDeviceMetricsOverride", **size)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.call("Emulation.setEmulatedMedia", media=media, features=features)
    browser.settle()
    return browser.run(FAULTS)
