"""Random scenes are seeded, what is silent is counted, and both tables reach the folder of the hard cases."""

from __future__ import annotations

from handbench.bench.results.stability import Table, load_stability
from handbench.bench.studies.stability.measure import run_stability
from tests.bench.studies.stability import measure_tables, silent_errors


def test_random_scenes_are_the_same_for_a_seed_and_count_what_is_silent(monkeypatch):
    """With a σ of nothing every pixel that is off at all counts."""
    first, again = silent_errors.table(3, 8), silent_errors.table(3, 8)
    assert first == again != silent_errors.table(4, 8)
    monkeypatch.setattr(silent_errors, "SIGMAS", 0.0)
    assert sum(row[4] for row in silent_errors.table(3, 8).rows[:2]) > sum(row[4] for row in first.rows[:2])


def test_the_tables_are_added_to_what_the_command_wrote(tmp_path, monkeypatch):
    facts, cases = run_stability("smoothing", tmp_path)
    table = Table(title="t", text="x", columns=("a", "b"), rows=(("1", 2.5), (None, 3)))
    monkeypatch.setattr(measure_tables, "measured", lambda seed, scenes: (table,))
    measure_tables.main(["--seed", "7", "--into", str(tmp_path)])
    kept, lines = load_stability(tmp_path)
    assert kept == facts.model_copy(update={"seed": 7, "tables": (table,)}) and lines.equals(cases)
