"""The documentation as a site: built strictly, from nothing that is fetched."""

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


@pytest.mark.slow
def test_the_site_has_every_page_and_fetches_nothing(tmp_path):
    """A warning of mkdocs, as of a page that is in no navigation, ends it with an error."""
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "-f", "docs/mkdocs.yml"]
    known = {"NO_MKDOCS_2_WARNING": "1", "SOURCE_DATE_EPOCH": "0", "PYTHONPATH": str(ROOT)}
    env = {**os.environ, **known}
    done = subprocess.run(
        [*command, "-d", tmp_path], cwd=ROOT, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "mae_mm" in (tmp_path / "metrics.html").read_text("utf-8")
    for page in tmp_path.rglob("*.html"):
        assert FETCHED.findall(page.read_text("utf-8")) == [], page
