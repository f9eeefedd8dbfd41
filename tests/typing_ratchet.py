"""The ratchet of types: mypy's errors per room, which may fall and not rise; strict rooms have
none.

python tests/typing_ratchet.py            fails where a room has more errors than typing_ratchet.json allows
python tests/typing_ratchet.py --lower    writes today's counts where they are lower
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECORD = Path(__file__).with_suffix(".json")
STRICT = ("radar", "calibration", "bench/evaluation", "handbench")
LINKS = ".types"  # where `make setup` links the rooms into one package, as mypy needs it
ROOMS = (*STRICT, "groundtruth", "bench", "reports")
ERROR = re.compile(r"^(?:\.types/handbench/)?([^:\s]+\.py):\d+: error: ")


def room(file: str) -> str:
    """The room of a file: the longest of ROOMS that it lies in. Raises ValueError for a file in
    none."""
    return max((name for name in ROOMS if file.startswith(f"{name}/")), key=len)


def counted(lines: Iterable[str]) -> dict[str, int]:
    """Errors per room in mypy's output."""
    found = Counter(
        room(match[1].replace("\\", "/")) for line in lines if (match := ERROR.match(line))
    )
    return {name: found[name] for name in ROOMS}


def verdict(found: dict[str, int], allowed: dict[str, int]) -> tuple[list[str], list[str]]:
    """The rooms that have too many errors, and those whose record can be lowered; each as a
    line."""
    limits = {name: 0 if name in STRICT else allowed.get(name, 0) for name in ROOMS}
    risen = [
        f"{name}: {found[name]} errors, {limits[name]} allowed"
        for name in ROOMS
        if found[name] > limits[name]
    ]
    fallen = [
        f"{name}: {found[name]} errors, {limits[name]} allowed"
        for name in ROOMS
        if found[name] < limits[name]
    ]
    return risen, fallen


def main(arguments: Sequence[str]) -> int:
    """Run mypy as pyproject.toml has it and compare; returns the exit code."""
    environment = {**os.environ, "MYPYPATH": LINKS}
    ran = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    if ran.returncode not in (0, 1):
        print(ran.stdout + ran.stderr)
        return ran.returncode
    found, allowed = counted(ran.stdout.splitlines()), json.loads(RECORD.read_text("utf-8"))
    risen, fallen = verdict(found, allowed)
    if "--lower" in arguments:
        lower = {
            name: min(found[name], allowed.get(name, 0)) for name in ROOMS if name not in STRICT
        }
        RECORD.write_text(json.dumps(lower, indent=2) + "\n", "utf-8")
    elif fallen:
        print("\n".join([*fallen, "fewer than allowed: python tests/typing_ratchet.py --lower"]))
    if risen:
        print("\n".join([*(line for line in ran.stdout.splitlines() if _of(line, risen)), *risen]))
    return 1 if risen else 0


def _of(line: str, risen: list[str]) -> bool:
    """Whether a line of mypy's is of a room that has too many errors."""
    match = ERROR.match(line)
    return match is not None and any(text.startswith(f"{room(match[1])}:") for text in risen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
