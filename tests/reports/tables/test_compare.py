"""Two results side by side: what is printed and written, strangers' names escaped."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from handbench.bench.evaluation.tables import CHANGES, DIFFERENCES, frame
from handbench.bench.results.compare_results import compare_results
from handbench.bench.results.result_folder import load
from handbench.cli import compare as compare_command
from handbench.cli.main import parser
from handbench.reports.tables import comparison
from handbench.support.errors import HandbenchError
from tests.reports.synthetic_result import write_synthetic

EVIL = "<b>50%_of$x & {y} \\ |[z]</b>"


@pytest.fixture(scope="module")
def result_folder(tmp_path_factory) -> Path:
    """A synthetic result whose protocol compares methods by their errors."""
    folder = tmp_path_factory.mktemp("result") / "table"
    return write_synthetic(folder, step_m=6e-3, tested=("mae_mm",))


@pytest.fixture(scope="module")
def other_folder(result_folder, tmp_path_factory) -> Path:
    """The synthetic result on a slower machine, with 1 mm more error in 3-FSK."""
    folder = tmp_path_factory.mktemp("other") / EVIL.replace("/", "")
    shutil.copytree(result_folder, folder)
    scores = pd.read_csv(folder / "scores.csv", keep_default_na=False)
    worse = (scores.method == "3fsk") & (scores.metric == "mae_mm")
    scores["value"] = pd.to_numeric(scores.value) + worse
    scores.to_csv(folder / "scores.csv", index=False)
    about = json.loads((folder / "result.json").read_text("utf-8"))
    about["machine"]["gemm_gflops"] = 50.0
    about["versions"]["numpy"] = EVIL
    (folder / "result.json").write_text(json.dumps(about), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def compared(result_folder, other_folder):
    return compare_results(load(result_folder), load(other_folder))


def run(*arguments: object):
    return compare_command.run(parser().parse_args(["compare", *map(str, arguments)]))


def test_markdown_escapes_and_marks_what_is_better(compared, tmp_path):
    comparison.write(compared, tmp_path)
    text = (tmp_path / "compare.md").read_text("utf-8")
    assert "<b>" not in text
    against_photogrammetry, _, changes = re.findall(r"(?:^\|.*\n)+", text, re.M)
    lines = against_photogrammetry.splitlines()
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
    assert len(lines) == 2 + 4 and against_photogrammetry.count("\\*") == 1
    assert changes.count("\n") == 2 + 2
    none = replace(compared, changes=frame(CHANGES), differences=frame(DIFFERENCES))
    comparison.write(none, tmp_path)


@pytest.mark.parametrize("width", [40, 80])
def test_the_terminal_shows_both_figures_and_no_more_than_fits(
    compared, width, monkeypatch, capsys
):
    monkeypatch.setenv("COLUMNS", str(width))
    comparison.show(compared)
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in lines if "/" not in line) <= width
    row = next(line for line in lines if line.startswith("3-FSK"))
    assert re.search(r"^3-FSK +([\d.]+)→([\d.]+)\*", row)


def test_the_command_writes_four_files(result_folder, other_folder, tmp_path, capsys):
    out = tmp_path / "out"
    run(result_folder, other_folder, "-o", out)
    kinds = ("csv", "json", "md", "tex")
    assert sorted(p.name for p in out.iterdir()) == [f"compare.{kind}" for kind in kinds]
    with (out / "compare.csv").open(encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    better = {(line["metric"], line["reference"]) for line in lines if line["better"] == "A"}
    assert {("mae_mm", "photogrammetry"), ("mae_mm", "truth")} <= better
    capsys.readouterr()
    run(result_folder, other_folder, "--json")
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "compare.json").read_text("utf-8"))
    assert printed["a"] == str(result_folder) and len(printed["differences"]) == len(lines)
    with pytest.raises(HandbenchError, match="exists already"):
        run(result_folder, other_folder, "-o", out)
    run(result_folder, other_folder, "-o", out, "--overwrite")
    with pytest.raises(HandbenchError, match="expected a folder with a benchmark's result"):
        run(result_folder, tmp_path / "nothing", "-o", tmp_path / "none")
    assert not (tmp_path / "none").exists()
