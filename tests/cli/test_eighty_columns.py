"""What commands print fits a terminal of 80 columns, and no figure is cut."""

from __future__ import annotations

import re
import sys

import pytest
from rich.cells import cell_len

from handbench.bench.results.result_folder import load
from handbench.bench.run import runner
from handbench.cli.main import main
from handbench.reports.figures import fronts
from handbench.reports.page import html
from tests.reports.synthetic_result import RESULTS, write_synthetic

SETTINGS = {f"3fsk-{n}-pixels": (f"3-FSK, {n} pixels", 2.0 / n, 0.01 * n) for n in range(1, 23)}
MISSPELT = """name = "misspelt"
repeat = 3
[[capture]]
name = "a capture whose folder is nowhere, and whose name is as long as a user's may be"
folder = "nowhere"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with results, and a benchmark that has many problems."""
    folder = tmp_path_factory.mktemp("eighty")
    results = RESULTS | {
        "settings": {"methods": SETTINGS, "references": ("truth",), "paper": False}
    }
    for name in ("table", "strangers", "settings"):
        write_synthetic(folder / name, **results[name] | {"captures": ("B",), "step_m": 8e-3})
    (folder / "misspelt.toml").write_text(MISSPELT)
    return folder


@pytest.mark.parametrize(
    "command",
    [
        "run paper_table -o table",
        "run paper_table -o strangers",
        "tradeoff tradeoff -o settings",
        "compare strangers strangers",
        "list",
        "list methods 3fsk",
        "doctor",
        "inspect misspelt.toml",
    ],
)
def test_lines_have_at_most_80_columns_and_figures_are_whole(command, folder, monkeypatch, capsys):
    words = command.split()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(runner, "run", lambda *_, **__: load(words[-1]))
    monkeypatch.setattr(fronts, "pictures", lambda _: [])
    monkeypatch.setattr(html, "build", lambda _, out: out)
    printed = []
    for columns in ("80", "300"):
        monkeypatch.setenv("COLUMNS", columns)
        if words[0] == "inspect":  # in a pipe, a problem has one line of any length
            monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
        assert main(words) == (2 if "misspelt.toml" in words else 0)
        printed.append(capsys.readouterr().out)
    narrow, wide = printed
    assert [line for line in narrow.splitlines() if cell_len(line) > 80] == []
    assert decimals(narrow) == decimals(wide)


def decimals(text: str) -> set[str]:
    return set(re.findall(r"\d+\.\d+", text))
