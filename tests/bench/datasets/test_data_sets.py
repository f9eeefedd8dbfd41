"""Whole data sets in a benchmark file, and what opens a folder."""

import numpy as np
import pytest

import handbench as hb
from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.dataset import open_capture
from tests.refusals import refuse

BENCH = """
version = 1
name = "set"
[[dataset]]
path = "maroon"
SELECTION
[[method]]
id = "3fsk"
"""
OBJECTS = ("patch/30", "patch/100", "a__cup/30", "a__cup/100")


@pytest.fixture(scope="module")
def data_set(tmp_path_factory):
    """Two objects of MAROON at two distances, and what is none: their registrations, an empty
    room, a text."""
    folder = tmp_path_factory.mktemp("set")
    at_m, samples = np.zeros((1, 3)), np.ones((1, 1, 1, 1))
    hb.save_capture(folder / "native", samples, [72e9], at_m, at_m)
    for place in (*OBJECTS, "00_registration/01_coarse/30", "01_empty/30"):
        (folder / "maroon" / place / "radar_1" / "calibrated_data").mkdir(parents=True)
        if not place.startswith("01"):
            (folder / "maroon" / place / "metadata.json").write_text("{}")
    (folder / "maroon" / "readme").mkdir()
    return folder


def paths(folder, selection):
    (folder / "b.toml").write_text(BENCH.replace("SELECTION", selection))
    bench, base = load_benchmark(str(folder / "b.toml"))
    assert base == folder
    return [source.path.removeprefix("maroon/") for source in bench.capture]


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ("", ["a__cup/30", "a__cup/100", "patch/30", "patch/100"]),
        ('objects = ["patch"]\ndistances = [100]', ["patch/100"]),
        ("distances = [30]\nlimit = 1\nempty_filtered = true", ["a__cup/30@emptyfiltered"]),
        ('limit = 1\n[[capture]]\npath = "native"', ["native", "a__cup/30"]),
    ],
)
def test_a_data_set_becomes_its_captures_after_others(data_set, selection, expected):
    assert paths(data_set, selection) == expected


def test_names_are_those_of_files(data_set):
    names = [open_capture(data_set / "maroon" / place).about.name for place in OBJECTS]
    assert names == ["patch-30", "patch-100", "a_cup-30", "a_cup-100"]


@pytest.mark.parametrize(
    ("selection", "place"),
    [
        ('objects = ["patches"]', "patches"),
        ("distances = [50]", "maroon"),
        ('[[dataset]]\npath = "../other"', "other"),
    ],
)
def test_selections_that_select_nothing_are_refused(data_set, selection, place):
    refuse(lambda: paths(data_set, selection), place)


def test_what_is_no_capture_is_refused(data_set, tmp_path):
    (tmp_path / "positions.csv").touch()
    for place, cure in (
        (data_set / "native@emptyfiltered", "@emptyfiltered"),
        (data_set, "a__cup/100"),  # one that is inside
        (tmp_path / "nowhere", "nowhere"),
        (tmp_path, "touchstone"),
    ):
        refuse(lambda place=place: open_capture(place), str(place), cure)
