"""`handbench design` as a user meets it: a table on the figures of the result, a file, refusals in one line."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from handbench.bench import results
from handbench.bench.evaluation.statistics.compare_results import figures_of
from handbench.bench.results.tables import CAPTURES, DESIGN, frame, read
from handbench.cli.main import main
from tests.reports.synthetic_result import write_synthetic


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_synthetic(tmp_path_factory.mktemp("design") / "five", step_m=6e-3)


def test_the_table_and_its_file(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "design.csv"
    assert main(["design", str(folder), "--effect", "0.2 mm", "--power", "0.9", "-o", str(out)]) == 0
    printed, result = capsys.readouterr().out, results.load(folder)
    assert "Hands that show 0.2 mm with a power of 90 %" in printed and "uncertain" not in printed
    lines, methods = read(out, DESIGN), [method.name for method in result.about.methods]
    assert len(lines) == len(methods) * (len(methods) - 1) / 2 and set(lines.a) | set(lines.b) == set(methods)
    assert (lines.n_captures == 5).all() and (lines.needed >= 5).all()
    figures = {name: result.row("mae_mm", name, "photogrammetry").value for name in methods}
    for line in lines.itertuples():  # what the result's own table says
        assert line.difference == pytest.approx(figures[line.b] - figures[line.a], abs=1e-9)
    found = figures_of(result, "mae_mm", "truth")
    assert {name: np.mean(values) for name, values in found.items()} == pytest.approx(
        {name: result.row("mae_mm", name, "truth").value for name in methods}
    )
    assert main(["design", str(folder), "--effect", "0.2mm", "-o", str(out)]) == 2  # it is there
    assert main(["design", str(folder), "--effect", "0.2mm", "-o", str(out), "--overwrite"]) == 0
    assert main(["design", str(folder), "--effect", "2%", "--metric", "complete_2mm_percent"]) == 0


def test_few_captures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    three = write_synthetic(tmp_path / "three", ("B", "F", "U"), step_m=6e-3)
    assert main(["design", str(three), "--effect", "200um"]) == 0
    assert "3 hands: the spread itself is uncertain" in capsys.readouterr().out
    two = write_synthetic(tmp_path / "two", ("B", "F"), step_m=6e-3)
    assert main(["design", str(two), "--effect", "0.2mm"]) == 2
    [error] = capsys.readouterr().err.strip().splitlines()
    assert error.startswith(f"handbench: {two}: variance components: 2 captures") and error.endswith("run more hands")


def test_equally_treated_figures_are_taken_where_the_result_has_them(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    treated = tmp_path / "treated"
    shutil.copytree(folder, treated)
    rng, methods = np.random.default_rng(5), [method.name for method in results.load(folder).about.methods]
    lines = [
        ("mae_mm", treatment, method, f"c{i}", rng.normal(number + (treatment == "none"), 0.1), "mm", "truth")
        for treatment in ("none", "window")
        for number, method in enumerate(methods)
        for i in range(6)
    ]
    results.write_tables(treated, captures=frame(CAPTURES, lines))
    for options, said in ([], "all averaged alike"), (["--treatment", "none"], "unsmoothed"):
        assert main(["design", str(treated), "--effect", "0.2mm", *options]) == 0
        assert f"against truth, {said}, 6 hands" in capsys.readouterr().out
    assert main(["design", str(treated), "--effect", "0.2mm", "--treatment", "own"]) == 0
    assert "each method as it is, 5 hands" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--effect", "0.2mm"], "expected a result folder and an effect"),
        (["FOLDER"], "expected a result folder and an effect"),
        (["FOLDER", "--effect", "0.2"], "--effect: is '0.2'"),
        (["FOLDER", "--effect", "2%"], "--effect: is '2%'"),
        (["FOLDER", "--effect", "-1mm"], "--effect"),
        (["FOLDER", "--effect", "1mm", "--power", "1"], "--power: is 1"),
        (["FOLDER", "--effect", "1mm", "--metric", "mae"], "did you mean 'mae_mm'?"),
    ],
)
def test_refusals(folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str) -> None:
    given = [str(folder) if argument == "FOLDER" else argument for argument in arguments]
    if "-1mm" in given:  # argparse takes it for an option
        with pytest.raises(SystemExit):
            main(["design", *given])
        return
    assert main(["design", *given]) == 2
    [error] = capsys.readouterr().err.strip().splitlines()
    assert words in error
