"""The two tables beside the catalogue of hard cases: the figures' significant digits, and random scenes.

python -m tests.bench.studies.stability.measure_tables [--seed 0] [--scenes 10000] [--into DIR]

--into: the folder of a `handbench stability -o DIR`, whose stability.json gets them, so that a report shows them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from handbench.bench.results.stability import Table, load_stability, write_stability
from handbench.bench.studies.stability.measure import markdown
from tests.bench.studies.stability import digits, silent_errors


def measured(seed: int, scenes: int) -> tuple[Table, ...]:
    """Both tables; the second of so many scenes (0: none)."""
    return (digits.table(seed), *([silent_errors.table(seed, scenes)] if scenes else []))


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, and write where --into asks for it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--scenes", type=int, default=10_000, help="random hard scenes (default 10000; 0: none)")
    parser.add_argument("--into", type=Path, metavar="DIR", help="folder with stability.csv and stability.json")
    given = parser.parse_args(arguments)
    kept = load_stability(given.into) if given.into else None
    tables = measured(given.seed, given.scenes)
    for table in tables:
        print(f"{table.title}: {table.text}\n\n{markdown(table.columns, table.rows)}")
    if kept is not None:
        facts, cases = kept
        write_stability(given.into, facts.model_copy(update={"seed": given.seed, "tables": tables}), cases)


if __name__ == "__main__":
    main()
