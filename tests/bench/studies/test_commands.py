"""The commands that measure, from the command line to their files, at the smallest size that they
take."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from tests.bench.studies.engine import measure_engine
from tests.bench.studies.exact import measure_exact


@pytest.mark.slow
def test_the_engine_s_benchmark_runs(tmp_path, capsys, monkeypatch):
    """As `make bench` does, of its sections one, on a small volume, and the figures that the bars
    ask for."""
    out = tmp_path / "bench.json"
    monkeypatch.setattr(
        "sys.argv", ["measure_engine", "--quick", "--only", "3-FSK", "-o", str(out)]
    )
    measure_engine.main()
    result = json.loads(out.read_text())
    assert result["failures"] == {} and {row["section"] for row in result["rows"]} == {
        "3-FSK frame"
    }
    expected = {"method", "seconds", "ratio_to_exact", "relative_error", "gflops", "peak_memory_mb"}
    assert all(expected <= set(row) for row in result["rows"])
    assert all(row["met"] for row in result["rows"] if "met" in row)
    assert "3-FSK frame" in capsys.readouterr().out


def test_the_exact_scenes_are_measured(tmp_path, capsys, monkeypatch):
    smallest = ["--tones", "few", "--only", "sphere of 2 mm, metal"]
    monkeypatch.setattr("sys.argv", ["measure_exact", *smallest, "-o", str(tmp_path)])
    measure_exact.main()
    [content] = [json.loads(file.read_text()) for file in tmp_path.glob("*.json")]
    assert content["rows"] and content["failures"] == {}
    assert not pd.read_csv(next(tmp_path.glob("*.csv"))).empty
    assert next(tmp_path.glob("*.md")).read_text().startswith("# ")
    assert "| " in capsys.readouterr().out
