"""`python -m tests.faults`: faults at scale, with their counts."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.faults.campaign import KINDS, Ground


def main() -> int:
    """Print tries and losses of each kind; exit code 1 where anything was lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument(
        "--tries", type=int, default=100, help="of each kind that is drawn at random (default 100)"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", default=[], choices=list(KINDS))
    options = parser.parse_args()
    tries: Counter[str] = Counter()
    losses: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="handbench-faults-") as scratch:
        ground = Ground(Path(scratch), options.tries, True, options.seed)
        for kind in options.kind or KINDS:
            start, before = time.monotonic(), tries.total()
            for each in KINDS[kind](ground):
                tries[each.kind] += 1
                losses[each.kind] += each.loss is not None
                if each.loss:
                    print(f"lost: {each.kind}: {each.what}: {each.loss[-1500:]}", flush=True)
            print(
                f"{kind}: {tries.total() - before} tries in {time.monotonic() - start:.0f} s",
                flush=True,
            )
    print(f"\n{'kind':40}{'tries':>8}{'losses':>8}")
    for kind in (*tries,):
        print(f"{kind:40}{tries[kind]:8}{losses[kind]:8}")
    print(f"{'all':40}{tries.total():8}{losses.total():8}")
    return int(bool(losses.total()))


if __name__ == "__main__":
    sys.exit(main())
