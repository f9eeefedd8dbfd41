"""Golden files, in tests/golden: texts that the product has written, and a result folder, whose
errors are drawn at random. `pytest --update-golden` writes the texts anew; a commit shows what has
changed."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

GOLDEN = Path(__file__).with_name("golden")
RESULT = GOLDEN / "result"  # captures B and F, four methods, one of them with a hostile title


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compares a text with the golden file of a name."""

    def compare(text: str, name: str) -> None:
        if request.config.getoption("update_golden"):
            (GOLDEN / name).write_text(text, "utf-8")
        assert text == (GOLDEN / name).read_text("utf-8")

    return compare


def renamed(folder: Path, names: dict[str, str]) -> Path:
    """Copy the golden result into a new folder, with other names of its captures."""
    shutil.copytree(RESULT, folder)
    for file in folder.glob("*/*.*"):
        file.rename(file.with_name(names.get(file.name[0], file.name[0]) + file.name[1:]))
    facts, scores = folder / "result.json", folder / "scores.csv"
    for old, new in names.items():
        facts.write_text(facts.read_text("utf-8").replace(f'"{old}"', json.dumps(new)), "utf-8")
        text = re.sub(f"^{old},", f'"{new}",', scores.read_text("utf-8"), flags=re.MULTILINE)
        scores.write_text(text, "utf-8")
    return folder
