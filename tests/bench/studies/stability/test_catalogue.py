"""Every hard case holds its bound, is refused in words, or flags what is wrong; and the catalogue itself can fail."""

from __future__ import annotations

import inspect
import sys
import tomllib
import warnings

import numpy as np
import pytest

from handbench.bench.results.stability import StabilityFacts, Table, load_stability, write_stability
from handbench.bench.studies.stability import balls, measure
from handbench.bench.studies.stability.cases import (
    CATALOGUE,
    GROUPS,
    Case,
    Refused,
    Seen,
    Works,
    Worst,
    cases,
    measured,
    refused,
    worst,
)
from handbench.bench.studies.stability.measure import run_stability
from handbench.support.errors import HandbenchError


@pytest.mark.parametrize("chosen", cases(), ids=lambda chosen: f"{chosen.group}: {chosen.name}")
def test_hard_case(chosen, monkeypatch):
    """A rigorous one compares with balls, whose radii are finite numbers."""
    compared = []
    monkeypatch.setattr(balls, "balls", lambda values, make=balls.balls: compared.append(1) or make(values))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = measured(chosen)
    said = f"{found['measured']} at {found['at']}: {found['reason']}"
    assert found["verdict"] in ("holds", "refused", "flagged"), said
    assert compared or chosen.kind != "rigorous"


def test_every_group_has_hard_cases_with_a_reason():
    found = cases()
    assert len(found) >= 60 and {case.group for case in found} == set(GROUPS)
    assert all(np.isfinite(case.bound) and len(case.reason) > 10 and case.reference for case in found)


def test_a_bound_is_typed_only_where_it_is_0_or_1_or_measured():
    """Of a refusal it is 0 answers; all others are formulas in code."""
    typed = tomllib.loads(CATALOGUE.read_text("utf-8"))
    entries = [entry for group in typed.values() for entry in group.values() if isinstance(entry, dict)]
    assert {entry.get("kind") for entry in entries if "words" not in entry} <= {"derived", "rigorous", "measured"}
    numbers = {entry["bound"] for entry in entries if "bound" in entry and entry["kind"] != "measured"}
    assert numbers <= {0.0, 1.0}


def test_no_measuring_function_is_forgotten():
    """Functions of the groups' modules that take nothing and give what a case sees, or has to refuse."""
    given = {id(getattr(case.measure, "args", (case.measure,))[0]) for case in cases()}
    modules = [module for name, module in sys.modules.items() if name.startswith("handbench.bench.studies.stability.")]
    functions = {f for module in modules for f in vars(module).values() if inspect.isfunction(f)}
    measuring = {
        f for f in functions if f.__annotations__.get("return") in (Seen, Works) and not f.__code__.co_argcount
    }
    assert {f.__qualname__ for f in measuring if "<locals>" not in f.__qualname__ and id(f) not in given} == set()


def raises():
    raise ZeroDivisionError("a bug")


@pytest.mark.parametrize(
    ("measure", "verdict"),
    [
        (lambda: 0.5, "holds"),
        (lambda: 2.0, "fails"),
        (lambda: Worst(2.0, "here", flagged=True), "flagged"),
        (lambda: Worst(2.0, "here"), "fails"),
        (lambda: worst([("a", 0.1), ("b", np.nan)]), "fails"),
        (lambda: Refused("no"), "refused"),
        (raises, "fails"),
        (lambda: refused(lambda: 1, "too large"), "fails"),
    ],
)
def test_verdicts(measure, verdict):
    assert measured(Case("x", "data", "q", "r", "mm", 1.0, "derived", "because", measure))["verdict"] == verdict


def test_a_refusal_has_to_say_why():
    def refuse():
        raise HandbenchError("volume: needs 300 GB; make the grid coarser")

    assert refused(refuse, "300 GB") == Refused("volume: needs 300 GB; make the grid coarser")
    assert refused(refuse, "antenna").value == np.inf


def test_what_was_written_is_read_back(tmp_path, monkeypatch):
    """Of the group's cases the first two: each has a test above."""
    monkeypatch.setattr(measure, "cases", lambda groups: cases(groups)[:2])
    facts, found = run_stability("statistics", folder=tmp_path)
    kept, lines = load_stability(tmp_path)
    assert kept == facts and lines.equals(found)
    assert kept.kinds == dict(zip(found.case, found.kind, strict=True))
    table = Table(title="t", text="x", columns=("a", "b"), rows=(("1", 2.5), (None, 3)))
    write_stability(tmp_path, StabilityFacts(seed=1, seconds=2.0, tables=(table,)), found)
    assert load_stability(tmp_path)[0].tables == (table,)


def test_an_unknown_group_names_the_nearest():
    with pytest.raises(HandbenchError, match="phase"):
        run_stability("phases")
