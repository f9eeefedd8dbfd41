"""Random scenes are seeded, and what is silent is counted."""

from __future__ import annotations

from tests.bench.studies.stability import silent_errors


def test_random_scenes_are_the_same_for_a_seed_and_count_what_is_silent(monkeypatch):
    """With a σ of nothing every pixel that is off at all counts."""
    first, again = silent_errors.table(3, 8), silent_errors.table(3, 8)
    assert first == again != silent_errors.table(4, 8)
    monkeypatch.setattr(silent_errors, "SIGMAS", 0.0)
    assert sum(row[4] for row in silent_errors.table(3, 8).rows[:2]) > sum(
        row[4] for row in first.rows[:2]
    )
