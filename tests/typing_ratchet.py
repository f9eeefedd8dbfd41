"""The ratchet of types: mypy's errors per room, which may fall and not rise; strict rooms have
none.

python tests/typing_ratchet.py            fails where a room has more errors than
                                          typing_ratchet.json allows
python tests/typing_ratchet.py --lower    writes today's counts where they are lower
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECORD = Path(__file__).with_suffix(".json")
STRICT = ("radar", "calibration", "bench/evaluation", "handbench")
LINKS = ".types"  # where `make setup` links the rooms into one package, as mypy needs it
ROOMS = (*STRICT, "groundtruth", "bench", "reports")
ERROR = re.compile(r"^(?:\.types/handbench/)?([^:\s]+\.py):\d+: error: ")


def room(line: str) -> str:
    """The room of a line of mypy's: the longest of ROOMS that its file lies in; "" where it is no
    error."""
    match = ERROR.match(line)
    holding = [name for name in ROOMS if match and match[1].startswith(f"{name}/")]
    return max(holding, key=len, default="")


def main() -> int:
    """Run mypy as pyproject.toml has it and compare; returns the exit code."""
    ran = subprocess.run(
        [sys.executable, "-m", "mypy"],
        cwd=ROOT,
        env={**os.environ, "MYPYPATH": LINKS},
        capture_output=True,
        text=True,
    )
    if ran.returncode not in (0, 1):
        print(ran.stdout + ran.stderr)
        return ran.returncode
    lines, allowed = ran.stdout.splitlines(), json.loads(RECORD.read_text("utf-8"))
    found = Counter(map(room, lines))
    risen = [name for name in ROOMS if found[name] > allowed.get(name, 0)]
    for name in risen:
        print("\n".join(line for line in lines if room(line) == name))
        print(f"{name}: {found[name]} errors, {allowed.get(name, 0)} allowed")
    if "--lower" in sys.argv:
        lower = {name: min(found[name], most) for name, most in allowed.items()}
        RECORD.write_text(json.dumps(lower, indent=2) + "\n", "utf-8")
    elif any(found[name] < most for name, most in allowed.items()):
        print("fewer than allowed: python tests/typing_ratchet.py --lower")
    return 1 if risen else 0


if __name__ == "__main__":
    sys.exit(main())
