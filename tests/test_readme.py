"""The tables of README and docs/results.md and the figure are those of the recorded result, of
today's benchmark."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from docs import readme
from handbench.bench.evaluation.metrics import METRICS, PAPER
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.run.benchmark_file import BenchFile, load_benchmark
from handbench.support.store import versions

ROOT = Path(__file__).parents[1]
MEND = "run `make table`, then `python -m docs.readme runs/table --write`"


@pytest.fixture(scope="module")
def recorded() -> dict:
    return json.loads((ROOT / "docs" / "table.json").read_text("utf-8"))


def test_the_table_the_figure_and_the_scenes_are_those_recorded():
    assert readme.stale(ROOT) == [], MEND


def test_the_record_is_of_todays_benchmark_and_definitions(recorded):
    """Whatever keys a newer benchmark file may have: what the recorded one says, read as today, is
    today's."""
    then = BenchFile.model_validate(tomllib.loads(recorded["config"]))
    now, chosen = load_benchmark("paper_table")[0], protocol(then.protocol)
    assert then.model_dump(exclude={"tradeoff"}) == now.model_dump(exclude={"tradeoff"}), MEND
    assert recorded["protocol"] == {"id": chosen.id, "version": chosen.version}, MEND
    assert recorded["versions"]["handbench"] == versions()["handbench"], MEND
    for key in readme.METRICS:
        for name in ("title", "unit", "better", "definition"):
            assert recorded["metrics"][key][name] == getattr(METRICS[key], name), MEND


def test_every_figure_is_there_with_the_papers(recorded):
    """Each method has each figure, but those without a precision of their own; the paper's are
    those of handbench.bench.evaluation.metrics."""
    rows = {(row["metric"], row["method"]): row for row in recorded["rows"]}
    measured = {entry.id for entry in load_benchmark("paper_table")[0].method if entry.precision}
    for metric in readme.METRICS:
        for method in readme.METHODS:
            if metric != "precision_mm" or method in measured:
                assert rows[metric, method]["value"] is not None
                assert rows[metric, method]["paper"] == PAPER.get((metric, method))
