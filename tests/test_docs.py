"""The documentation's code runs, and its links lead somewhere."""

import re
from pathlib import Path

import pytest

from bench.registry import METHODS, method

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_the_method_of_the_page_registers():
    method("2fsk")  # loads the built-in ones
    [code] = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "methods.md").read_text("utf-8"), re.DOTALL)
    try:
        exec(compile(code, "docs/methods.md", "exec"), {"__name__": "page"})
        assert method("wide2fsk").configure({}, "page").f2_hz == 81.0e9
    finally:
        METHODS.pop("wide2fsk", None)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        assert "://" in target or (page.parent / target).exists(), target
