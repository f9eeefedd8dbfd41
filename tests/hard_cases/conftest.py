"""The bounds of the hard cases, and the table of what came nearest to them.

A hard case is a sweep through the limit of something that can blow up and past it. Its test's name
says what holds, its docstring the reason for the bound, which holds on every machine.
"""

import re
from collections import defaultdict

import numpy as np
import pytest

TEST = re.compile(r"hard_cases/test_(\w+)_cases\.py::test_(\w+)(?:\[(.*)\])?$")
COLUMNS = ("group", "case", "bound", "worst", "unit", "where", "verdict")
VERDICTS = ("refused", "holds", "flagged", "fails")  # the worst is the last


@pytest.fixture
def within(record_property):
    """Assert that a value keeps its bound, unless the answer is marked as unreliable: by a flag,
    NaN or a stated σ that covers it."""

    def check(value, bound, unit, place="", flagged=False):
        verdict = "holds" if value <= bound else "flagged" if flagged else "fails"
        record_property(verdict, (float(value), float(bound), unit, place))
        assert verdict != "fails", f"{value:.3g} {unit}, at most {bound:.3g}: {place}"

    return check


def pytest_terminal_summary(terminalreporter):
    """Print a line a case: the worst of its sweep. A test without a value is one of refusals."""
    cases = defaultdict(list)
    for outcome, verdict in (("passed", "refused"), ("failed", "fails")):
        for report in terminalreporter.getreports(outcome):
            if match := TEST.search(report.nodeid):
                group, name, parameters = match.groups(default="")
                sweep = [*report.user_properties, (verdict, (np.nan, np.nan, "", ""))]
                cases[group, name] += [(*one, parameters) for one in sweep]
    lines = [COLUMNS, ["---"] * len(COLUMNS)] if cases else []
    for (group, name), sweep in cases.items():
        verdict, (value, bound, unit, place), parameters = max(
            sweep, key=lambda one: (VERDICTS.index(one[0]), one[1][0])
        )
        cells = f"{bound:.3g}", f"{value:.3g}", unit, f"{parameters} {place}".strip()
        lines.append((group, name.replace("_", " "), *(cells if unit else [""] * 4), verdict))
    for line in lines:
        terminalreporter.write_line("| " + " | ".join(line) + " |")
