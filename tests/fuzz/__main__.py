"""`python -m tests.fuzz`: the whole campaign, with its counts."""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path

from handbench.support.files import write_json
from handbench.support.progress import say
from tests.fuzz.campaign import FINDINGS, Tally, fuzz, line_of, planned
from tests.fuzz.readers import READERS

VERDICTS = ("accepted", "refused", *FINDINGS)


def table(tallies: dict[str, Tally]) -> str:
    """Counts, rate, slowest input and peak memory of every reader, and of all."""
    lines = [
        f"{'reader':14}"
        + "".join(f"{name:>10}" for name in (*VERDICTS, "inputs/s", "slowest s", "peak MB"))
    ]
    total = Tally()
    for tally in tallies.values():
        total.verdicts.update(tally.verdicts)
        total.seconds += tally.seconds
        total.slowest_s, total.peak_mb = (
            max(total.slowest_s, tally.slowest_s),
            max(total.peak_mb, tally.peak_mb),
        )
    for name, tally in (*tallies.items(), ("all", total)):
        rate = tally.verdicts.total() / max(tally.seconds, 1e-9)
        lines.append(
            f"{name:14}"
            + "".join(f"{tally.verdicts[v]:10}" for v in VERDICTS)
            + f"{rate:10.0f}{tally.slowest_s:10.2f}{tally.peak_mb:10.0f}"
        )
    return "\n".join(lines)


def main() -> int:
    """Print the counts; exit code 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--reader", action="append", default=[], choices=[reader.name for reader in READERS]
    )
    parser.add_argument("-o", dest="folder", type=Path, help="for fuzz.json and found.jsonl")
    options = parser.parse_args()
    tallies: dict[str, Tally] = defaultdict(Tally)
    found = []
    for given, seen, seconds in fuzz(planned(options.inputs, options.seed, options.reader)):
        tallies[given.reader].add(seen, seconds)
        if seen.verdict in FINDINGS:
            say(f"{given.reader} {given.number}: {seen.verdict}: {seen.detail}")
            found.append((given, seen))
    print(table(tallies))
    if options.folder:
        write_json(
            options.folder / "fuzz.json", {name: asdict(tally) for name, tally in tallies.items()}
        )
        lines = [line_of(given, seen) for given, seen in found]
        (options.folder / "found.jsonl").write_text(
            "".join(f"{line}\n" for line in lines), encoding="utf-8"
        )
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
