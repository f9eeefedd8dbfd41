"""The documentation as a site: built strictly, from nothing that is fetched, with every page in its
navigation."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FETCHED = re.compile(
    r'<(?:script|link|img|iframe|source)[^>]*(?:src|href|srcset)="?(?:https?:)?//[^" >]*'
)
LINKED = re.compile(r'<a [^>]*href="([^"#:]+)(?:#([^"]*))?"')


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site as `make docs` builds it; a warning of mkdocs ends it with an error."""
    out = tmp_path_factory.mktemp("site") / "out"
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "-f",
        "docs/mkdocs.yml",
        "-d",
        str(out),
    ]
    env = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "NO_MKDOCS_2_WARNING": "1",
        "SOURCE_DATE_EPOCH": "0",
    }
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    return out


def test_every_page_is_built_and_in_the_navigation(site):
    """As read from the folder, not from the site's own list."""
    pages = {
        path.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        for path in ROOT.glob("docs/**/*.md")
    }
    pages |= {
        path.relative_to(ROOT).with_suffix(".html").as_posix()
        for path in ROOT.glob("examples/*.ipynb")
    }
    pages = (pages - {"README.html"}) | {
        "index.html",
        "contents.html",
        "contributing.html",
        "changelog.html",
    }
    assert {page for page in pages if not (site / page).is_file()} == set()
    front = (site / "index.html").read_text("utf-8")
    navigation = front[front.index("md-nav--primary") :]
    assert {page for page in pages if f'href="{page}"' not in navigation} == set()


def test_nothing_is_fetched(site):
    """No page asks another host for a script, a style, a font or a picture."""
    for page in site.rglob("*.html"):
        assert FETCHED.findall(page.read_text("utf-8")) == [], page
    for style in site.rglob("*.css"):
        assert not re.search(
            r"(?:@import|url\()[^)]{0,9}(?:https?:)?//", style.read_text("utf-8")
        ), style


def test_links_lead_to_pages_and_headings(site):
    """Each link of each page, read once more from what was built."""
    pages = {
        page.resolve(): page.read_text("utf-8")
        for page in site.rglob("*.html")
        if page.name != "404.html"
    }
    anchors = {page: set(re.findall(r' id="([^"]+)"', text)) for page, text in pages.items()}
    for page, text in pages.items():
        for target, anchor in LINKED.findall(text):
            there = (page.parent / target).resolve()
            assert there.exists(), (page.name, target)
            assert not anchor or there not in anchors or anchor in anchors[there], (
                page.name,
                target,
                anchor,
            )


def test_formulas_are_pictures(site):
    text = (site / "methods.html").read_text("utf-8")
    words = re.sub(
        r"<code>.*?</code>|<script.*?</script>|alt=\"[^\"]*\"", "", text, flags=re.DOTALL
    )
    assert text.count('class="math"') > 50 and "$" not in words


def test_parameters_are_told_one_by_one(site):
    """A table of parameters under each function of the public face."""
    text = (site / "api" / "handbench.html").read_text("utf-8")
    for name in (
        "method",
        "frame",
        "settings",
        "mesh",
        "transform",
        "scene",
        "folder",
        "photos",
        "captures",
        "bench",
    ):
        assert re.search(rf"<code>\**{name}</code>", text), name
