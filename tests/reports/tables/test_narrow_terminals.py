"""Tables on terminals that are narrower than they are."""

import re

import pandas as pd
import pytest

from handbench.reports.tables.table import Table
from handbench.reports.tables.writers import terminal

TEXTS = {
    "why": ["needs [sensor.positions] with sigma", "listed"],
    "depth (mm)": ["1234.5678", "9.5\n[9.1, 9.9]"],
    "MAE on common pixels (mm)": ["0.123\n[0.101, 0.145]", "–"],
}
TABLE = Table("", pd.DataFrame(TEXTS, ["obliquity", "skin"]), left=1)


@pytest.mark.parametrize("width", [60, 80, 200])
def test_no_word_and_no_figure_is_cut(width, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    terminal(TABLE)
    printed = capsys.readouterr().out
    texts = [*TABLE.headings, *TABLE.texts.index, *TABLE.texts.to_numpy().flat]
    words = {word for text in texts for word in text.partition("\n")[0].split()}
    assert words <= set(re.split(r"\s+", printed))
    assert max(map(len, printed.splitlines())) <= width
