"""Two results side by side: what is printed and written."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from handbench.bench.evaluation.scoring_protocols import PAPER, main_table
from handbench.bench.evaluation.tables import CHANGES, DIFFERENCES, SCORES, frame, read
from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import load, write_tables
from handbench.cli.main import main
from handbench.reports.tables import comparison
from tests.bench.run.faults import files_of_at_most
from tests.golden_files import RESULT
from tests.refusals import refuse_command


@pytest.fixture(scope="module")
def slower(tmp_path_factory) -> Path:
    """The golden result on another machine, with more error in 3-FSK."""
    folder = tmp_path_factory.mktemp("compare") / "slower|[z]"
    shutil.copytree(RESULT, folder)
    scores, about = folder / "scores.csv", folder / "result.json"
    scores.write_text(
        scores.read_text().replace("3fsk,truth,,0,mae_mm,1", "3fsk,truth,,0,mae_mm,2")
    )
    table = main_table(read(scores, SCORES), PAPER, 0, with_paper=True)
    write_tables(folder, table=table)
    about.write_text(about.read_text("utf-8").replace("EPYC", "<b>EPYC</b> |"), "utf-8")
    return folder


@pytest.fixture
def compared(slower):
    """Their comparison, where the difference in MAE is shown."""
    both = compare_results(load(RESULT), load(slower))
    lines = both.differences.copy()
    of_3fsk = (lines.method == "3fsk") & (lines.metric == "mae_mm") & (lines.capture == "")
    shown = of_3fsk & (lines.reference == "truth")
    lines.loc[shown, ["better", "p_corrected", "untested"]] = "A", 1e-4, ""
    return replace(both, differences=lines)


def test_files_have_both_figures_their_difference_and_what_else_differs(
    compared, slower, golden, tmp_path
):
    comparison.write(compared, tmp_path)
    for kind in ("md", "tex"):
        text = (tmp_path / f"compare.{kind}").read_text("utf-8")
        golden(text.replace(str(RESULT), "A").replace(str(slower.parent), ""), f"compare.{kind}")
    none = replace(compared, changes=frame(CHANGES), differences=frame(DIFFERENCES))
    comparison.write(none, tmp_path)


@pytest.mark.parametrize("columns", [40, 80])
def test_a_terminal_shows_both_figures(compared, columns, golden, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    comparison.show(compared)
    golden(capsys.readouterr().out.split("\n", 2)[2], f"compare_{columns}.txt")


def test_the_command_writes_what_it_prints_and_overwrites_when_asked(slower, tmp_path, capsys):
    command, out = ["compare", str(RESULT), str(slower)], tmp_path / "out"
    assert main([*command, "-o", str(out)]) == 0
    assert {file.suffix for file in out.iterdir()} == {".csv", ".json", ".md", ".tex"}
    capsys.readouterr()
    assert main([*command, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "compare.json").read_text("utf-8"))
    with (out / "compare.csv").open(encoding="utf-8") as stream:
        assert len(printed["differences"]) == len(list(csv.DictReader(stream)))
    refuse_command([*command, "-o", str(out)], str(out), "--overwrite")
    with files_of_at_most(30_000):  # compare.csv is smaller, compare.json larger
        refuse_command([*command, "-o", str(tmp_path / "full")], "full/compare.json")
    assert list(tmp_path.iterdir()) == [out]
    capsys.readouterr()
    assert main([*command, "--metric", "seconds", "--method", "3fsk"]) == 0
    assert "3-FSK" in (table := capsys.readouterr().out) and "2-FSK" not in table
    refuse_command([*command, "--method", "3fks"], "'3fks'", "'3fsk'")
    assert main([*command, "-o", str(out), "--overwrite"]) == 0
