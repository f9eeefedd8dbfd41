"""Two tables: the significant digits of the benchmark's figures, and silent errors in random
scenes.

python -m tests.bench.studies.stability.measure_tables [--seed 0] [--scenes 10000]
"""

from __future__ import annotations

import argparse

from tests.bench.studies.stability import digits, silent_errors


def main() -> None:
    """Measure both tables and print them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument(
        "--scenes", type=int, default=10_000, help="random hard scenes (default 10000; 0: none)"
    )
    given = parser.parse_args()
    tables = [digits.table(given.seed)]
    if given.scenes:
        tables.append(silent_errors.table(given.seed, given.scenes))
    for table in tables:
        print(f"{table.title}: {table.text}\n\n{table.markdown()}")


if __name__ == "__main__":
    main()
