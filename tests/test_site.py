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
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site as `make docs` builds it; a warning of mkdocs ends it with an error."""
    out = tmp_path_factory.mktemp("site") / "out"
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "-f", "docs/mkdocs.yml", "-d", out]
    known = {"NO_MKDOCS_2_WARNING": "1", "SOURCE_DATE_EPOCH": "0", "PYTHONPATH": str(ROOT)}
    env = {**os.environ, **known}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    return out


def test_every_page_is_built_and_in_the_navigation(site):
    """As read from the folder, not from the site's own list."""
    pages = {path.relative_to(ROOT / "docs") for path in ROOT.glob("docs/**/*.md")}
    pages |= {path.relative_to(ROOT) for path in ROOT.glob("examples/*.ipynb")}
    names = {page.with_suffix(".html").as_posix() for page in pages} - {"README.html"}
    names |= {"index.html", "contents.html", "contributing.html", "changelog.html"}
    assert {name for name in names if not (site / name).is_file()} == set()
    front = (site / "index.html").read_text("utf-8")
    navigation = front[front.index("md-nav--primary") :]
    assert {name for name in names if f'href="{name}"' not in navigation} == set()


def test_nothing_is_fetched(site):
    """No page asks another host for a script, a style, a font or a picture."""
    for page in site.rglob("*.html"):
        assert FETCHED.findall(page.read_text("utf-8")) == [], page
    for style in site.rglob("*.css"):
        text = style.read_text("utf-8")
        assert not re.search(r"(?:@import|url\()[^)]{0,9}(?:https?:)?//", text), style
