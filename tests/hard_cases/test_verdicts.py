"""A hard case fails where it has to, and the page has the table of all of them."""

from __future__ import annotations

import warnings

import pytest

from handbench.support.errors import HandbenchError
from tests.hard_cases.__main__ import GROUPS, cases
from tests.hard_cases.cases import hard_case, refusal
from tests.test_docs import DOCS


def checked(sweep, kind="derived"):
    """The test of a sweep whose bound is 1."""
    return hard_case(
        "x", kind=kind, bound=1.0, unit="mm", quantity="q", reference="r", reason="because"
    )(sweep)


@pytest.mark.parametrize(
    ("seen", "holds"),
    [
        ([("a", 0.5)], True),
        ([("a", 0.5), ("b", 2.0)], False),
        ([("a", float("nan"))], False),
        ([("a", 2.0, True), ("b", 0.5, False)], True),
        ([("a", 3.0, True), ("b", 2.0, False)], False),
    ],
)
def test_what_is_beyond_the_bound_and_not_marked_fails(seen, holds):
    if holds:
        checked(lambda: seen)()
    else:
        with pytest.raises(AssertionError, match="because"):
            checked(lambda: seen)()


def test_an_empty_sweep_a_warning_and_a_rigorous_case_without_balls_fail():
    with pytest.raises(ValueError):
        checked(lambda: [])()
    with pytest.raises(UserWarning):
        checked(lambda: [("a", 0.0 if warnings.warn("no", stacklevel=1) is None else 1.0)])()
    with pytest.raises(AssertionError, match="no comparison with ball arithmetic"):
        checked(lambda: [("a", 0.0)], kind="rigorous")()


def test_a_refusal_has_to_say_why():
    def refuse():
        raise HandbenchError("volume: needs 300 GB; make the grid coarser")

    refusal("x", "300 GB")(lambda: [("a", refuse, "coarser")])()
    for words, work in ((("antenna",), refuse), ((), lambda: 1)):
        with pytest.raises(AssertionError, match="an answer"):
            refusal("x", *words)(lambda work=work: [("a", work)])()


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
