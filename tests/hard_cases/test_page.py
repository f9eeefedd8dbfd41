"""The page has the table of all hard cases."""

from __future__ import annotations

from tests.hard_cases.__main__ import GROUPS, cases
from tests.test_docs import DOCS


def test_the_page_lists_every_case_with_its_bound():
    lines = (DOCS / "stability.md").read_text("utf-8").splitlines()
    listed = [
        line.split(" | ")[:4]
        for line in lines
        if line.startswith(tuple(f"| {g} | " for g in GROUPS))
    ]
    expected = [
        [f"| {g}", case.name, case.kind, f"{case.bound:.3g}"] for g in GROUPS for case in cases(g)
    ]
    assert [line for line in listed if not line[1].isdigit()] == expected
    assert all(case.reason for group in GROUPS for case in cases(group))
