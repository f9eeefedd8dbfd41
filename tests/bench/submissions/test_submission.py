"""What is handed in is checked before it is scored: every hole, grid, number and checksum is told by name."""

import numpy as np
import pytest

from handbench.bench.submissions.submission import (
    DEPTHS,
    DESCRIPTION,
    Row,
    Submission,
    load_submission,
    problems,
    read_map,
    save_submission,
    sha256,
)
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError

GRID = PixelGrid(np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3))
GRIDS = {"A": GRID, "B, left": GRID}  # a name with a comma is a name


def content(**changed):
    z_m = np.full(GRID.shape, 0.3)
    z_m[0, 0] = np.nan
    return {"x_m": GRID.x_m, "y_m": GRID.y_m, "z_m": z_m, "amplitude_db": np.zeros(GRID.shape)} | changed


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "maps").mkdir()
    rows = {}
    for number, name in enumerate(GRIDS):
        file = tmp_path / "maps" / f"{number}.npz"
        np.savez(file, **content(amplitude_db=np.full(GRID.shape, -float(number))))
        rows[name] = Row(name, f"maps/{number}.npz", sha256(file), 0.25)
    save_submission(tmp_path, Submission(method="mine", benchmark="small"), rows)
    return tmp_path


def told(folder):
    return " | ".join(problems(folder, GRIDS, "small"))


def test_a_whole_submission_has_no_problem_and_comes_back(folder):
    assert told(folder) == ""
    about, rows = load_submission(folder)
    assert about.inputs == ("echoes",) and list(rows) == list(GRIDS) and rows["A"].seconds == 0.25


def lines(folder, change):
    text = (folder / DEPTHS).read_text().splitlines()
    (folder / DEPTHS).write_text("\n".join(change(text)) + "\n")


WRONG = {
    "a hole": (lambda text: text[:-1], "1 of 2 captures are missing: B, left"),
    "a stranger": (lambda text: [*text, "C,maps/0.npz,0,1"], "'C' is no capture of 'small'"),
    "another file": (lambda text: [line.replace("maps/0", "maps/1") for line in text], "has the checksum"),
    "outside": (lambda text: [line.replace("maps/0.npz", "../0.npz") for line in text], "leaves the folder"),
    "no file": (
        lambda text: [line.replace("maps/0.npz", "maps/7.npz") for line in text],
        "expected a depth map, found",
    ),
}


@pytest.mark.parametrize(("change", "words"), WRONG.values(), ids=WRONG)
def test_wrong_tables_are_told(folder, change, words):
    lines(folder, change)
    assert words in told(folder)


BROKEN = {
    "NaN seconds": (lambda text: [text[0], text[1].replace("0.25", "nan"), text[2]], "seconds is 'nan'"),
    "no seconds": (lambda text: [text[0], text[1].replace("0.25", "0"), text[2]], "expected a number above 0"),
    "twice": (lambda text: [*text, text[1]], "has 'A' again"),
    "columns": (lambda text: ["capture,file", *text[1:]], "has the columns"),
    "an open quote": (lambda text: [*text, '"C'], "is not readable as CSV"),
    "short": (lambda text: [text[0], "A,maps/0.npz"], "expected 4 values"),
}


@pytest.mark.parametrize(("change", "words"), BROKEN.values(), ids=BROKEN)
def test_tables_that_cannot_be_read_are_refused(folder, change, words):
    lines(folder, change)
    with pytest.raises(HandbenchError, match=words):
        load_submission(folder)


def test_a_changed_map_and_another_benchmark_are_told(folder):
    np.savez(folder / "maps" / "0.npz", **content(z_m=np.full(GRID.shape, 0.31)))
    assert "has the checksum" in told(folder)
    (folder / DESCRIPTION).write_text('version = 1\nmethod = "mine"\nbenchmark = "large"\n')
    assert told(folder) == f"{folder / DESCRIPTION}: is of the benchmark 'large'; expected 'small'"


MAPS = {
    "moved": ({"x_m": GRID.x_m + 1e-5}, "x_m is another grid"),
    "NaN in the grid": ({"y_m": GRID.y_m * np.nan}, "y_m is another grid"),
    "coarser": ({"x_m": GRID.x_m[::2], "z_m": np.ones((3, 3))}, "x_m is another grid"),
    "turned": ({"z_m": np.full(GRID.shape[::-1], 0.3)}, r"z_m is float64 \(5, 3\); expected real numbers \(3, 5\)"),
    "whole numbers": ({"z_m": np.ones(GRID.shape, int)}, "z_m is int64"),
    "infinite": ({"z_m": np.full(GRID.shape, np.inf)}, "infinite depths"),
    "empty": ({"z_m": np.full(GRID.shape, np.nan)}, "no depth at all"),
    "NaN amplitudes": ({"amplitude_db": np.full(GRID.shape, np.nan)}, "amplitude_db is not finite"),
    "millimetres": ({"z_m": np.full(GRID.shape, 300.0)}, "are these millimetres"),
}


@pytest.mark.parametrize(("changed", "words"), MAPS.values(), ids=MAPS)
def test_maps_that_cannot_be_scored_are_refused(tmp_path, changed, words):
    np.savez(tmp_path / "a.npz", **content(**changed))
    with pytest.raises(HandbenchError, match=words):
        read_map(tmp_path / "a.npz", "mine", GRID)


def test_a_map_is_read_as_it_was_written(tmp_path):
    np.savez(tmp_path / "a.npz", **content(x_m=GRID.x_m + 1e-8))
    depth = read_map(tmp_path / "a.npz", "mine", GRID)
    assert depth.method == "mine" and np.isnan(depth.z_m[0, 0]) and depth.z_m[1, 1] == np.float32(0.3)
    assert np.array_equal(depth.x_m, GRID.x_m)  # the benchmark's own, so that all methods share one grid
