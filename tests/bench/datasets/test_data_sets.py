"""Whole data sets in a benchmark file, and what opens a folder."""

import shutil
from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile
from handbench.support.config import load
from handbench.support.errors import HandbenchError

BENCH = """
version = 1
name = "set"
[[dataset]]
path = "maroon"
SELECTION
[[method]]
id = "3fsk"
"""


@pytest.fixture(scope="module")
def data_set(tmp_path_factory, native, maroon):
    """Two objects at two distances, and what is none: their registrations, an empty room, a
    text."""
    folder = tmp_path_factory.mktemp("set")
    shutil.copytree(native, folder / "native")
    for place in ("patch/30", "patch/100", "cup/30", "cup/100", "00_registration/01_coarse/30"):
        shutil.copytree(maroon, folder / "maroon" / place)
    shutil.copytree(maroon, folder / "maroon" / "01_empty" / "30")
    (folder / "maroon" / "01_empty" / "30" / "metadata.json").unlink()
    (folder / "maroon" / "readme").mkdir()
    return folder


def found(folder, selection):
    (folder / "b.toml").write_text(BENCH.replace("SELECTION", selection))
    bench, base = load_benchmark(str(folder / "b.toml"))
    assert base == folder
    return [source.path for source in bench.capture]


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ("", ["maroon/cup/30", "maroon/cup/100", "maroon/patch/30", "maroon/patch/100"]),
        ('objects = ["patch"]\ndistances = [100]', ["maroon/patch/100"]),
        ("distances = [30]\nlimit = 1\nempty_filtered = true", ["maroon/cup/30@emptyfiltered"]),
        ('limit = 1\n[[capture]]\npath = "native"', ["native", "maroon/cup/30"]),
    ],
)
def test_a_data_set_becomes_its_captures_after_others(data_set, selection, expected):
    assert found(data_set, selection) == expected


def test_names_are_unique_and_name_files(data_set):
    shutil.copytree(data_set / "maroon" / "cup" / "30", data_set / "odd" / "..a__cup" / "30")
    paths = [*found(data_set, ""), "odd/..a__cup/30"]
    names = [open_capture(data_set / path).about.name for path in paths]
    assert names == ["cup-30", "cup-100", "patch-30", "patch-100", "a_cup-30"]


@pytest.mark.parametrize(
    ("selection", "reason"),
    [
        ('objects = ["cups"]', "has no captures of an object 'cups'; did you mean 'cup'"),
        ("distances = [50]", "none of its captures is selected.* are: 100, 30"),
        ('object = ["cup"]', r"unknown key 'dataset\.0\.object'; did you mean 'objects'"),
        ("limit = 0", r"'dataset\.0\.limit' is 0"),
        ('[[dataset]]\npath = "../maroon"', "is outside the folder"),
    ],
)
def test_selections_that_select_nothing_are_refused(data_set, selection, reason):
    with pytest.raises(HandbenchError, match=reason):
        found(data_set, selection)


def test_what_opens_a_folder(data_set, tmp_path):
    native = open_capture(data_set / "native")
    known = load(CaptureFile, native.folder / "capture.toml", "a capture description")
    assert (native.about, native.truth) == (known, native.folder / "truth.ply")
    assert native.mesh() is native.photos is native.transform() is None
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "positions.csv").touch()
    for place, words in (
        (f"{native.folder}@emptyfiltered", "only captures of MAROON have frames @emptyfiltered"),
        (tmp_path, r"is not a capture; expected capture\.toml \(handbench\), mapping\.toml"),
        (tmp_path / "nowhere", "expected a folder with a capture, found none"),
        (tmp_path / "scan", "run `handbench import touchstone`"),
    ):
        with pytest.raises(HandbenchError, match=words):
            open_capture(Path(place))
