"""Tables on terminals that are narrower than they are."""

import re
import sys

import pytest
from rich.console import Console

from handbench.reports.tables import result_tables
from handbench.reports.tables.result_tables import print_table, terminal_table

CELLS = [
    ("shadow_antennas", "1234.5678", "0.123 [0.101, 0.145]", "needs [sensor.positions] with sigma"),
    ("skin", "9.5", "–", "listed"),
]


@pytest.mark.parametrize("width", [20, 40, 60, 80, 200])
def test_no_word_and_no_figure_is_cut(width, monkeypatch, capsys):
    monkeypatch.setattr(
        result_tables,
        "wide_console",
        lambda piped=200: Console(file=sys.stdout, width=width, color_system=None),
    )
    print_table(terminal_table("", ("effect", "depth mm", "MAE", "why"), CELLS, ("effect", "why")))
    shown = capsys.readouterr().out
    words = {word for row in CELLS for cell in row for word in cell.split()}
    assert words <= set(re.split(r"\s+", shown))
    assert max(map(len, shown.splitlines())) <= max(width, 65)
    assert (len(shown.splitlines()) == 6) == (width == 200)
