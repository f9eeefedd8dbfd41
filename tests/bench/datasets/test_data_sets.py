"""Whole data sets in a benchmark file, and what opens a folder."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.mapped_capture import Mapping, PairsMapping
from handbench.bench.datasets.native import CaptureFile
from handbench.bench.run.benchmark_file import BenchFile, Source, load_benchmark
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from tests.bench.datasets.foreign_captures import echoes, write_native
from tests.bench.datasets.maroon_writer import write_maroon

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
def data_set(tmp_path_factory):
    """Two objects at two distances, and a capture folder beside them."""
    folder = tmp_path_factory.mktemp("set")
    native = write_native(folder / "native", echoes(1))
    written = write_maroon(native, folder / "maroon")
    for other in ("patch/40", "cup/30", "cup/40"):
        shutil.copytree(written, folder / "maroon" / other)
    return folder


def found(folder, selection):
    (folder / "b.toml").write_text(BENCH.replace("SELECTION", selection))
    bench, base = load_benchmark(str(folder / "b.toml"))
    assert base == folder
    return [source.path for source in bench.capture]


@pytest.mark.parametrize(
    "selection, expected",
    [
        ("", ["cup/30", "cup/40", "patch/30", "patch/40"]),
        ("distances = [30]", ["cup/30", "patch/30"]),
        ('objects = ["patch"]', ["patch/30", "patch/40"]),
        ('objects = ["patch"]\ndistances = [40]', ["patch/40"]),
        ("limit = 3", ["cup/30", "cup/40", "patch/30"]),
        ("limit = 1\nempty_filtered = true", ["cup/30@emptyfiltered"]),
    ],
)
def test_a_data_set_becomes_its_captures(data_set, selection, expected):
    assert found(data_set, selection) == [f"maroon/{path}" for path in expected]


def test_names_are_unique_and_name_files(data_set):
    shutil.copytree(data_set / "maroon" / "cup", data_set / "odd" / "..a__cup", dirs_exist_ok=True)
    names = [open_capture(data_set / path).about.name for path in found(data_set, "")]
    assert names == ["cup-30", "cup-40", "patch-30", "patch-40"]
    assert open_capture(data_set / "odd" / "..a__cup" / "30").about.name == "a_cup-30"


def test_captures_of_their_own_come_first(data_set):
    content = {"version": 1, "name": "b", "method": [{"id": "3fsk"}]}
    with pytest.raises(ValueError, match="nothing to run"):
        BenchFile(**content)
    capture = found(data_set, '[[capture]]\npath = "native"')
    assert capture == [
        "native",
        "maroon/cup/30",
        "maroon/cup/40",
        "maroon/patch/30",
        "maroon/patch/40",
    ]
    assert BenchFile(**content, capture=[Source(path="native")]).dataset is None


@pytest.mark.parametrize(
    "selection, reason",
    [
        ('objects = ["cups"]', "has no captures of an object 'cups'; did you mean 'cup'"),
        ("distances = [50]", "has no capture that was asked for"),
        ('object = ["cup"]', r"unknown key 'dataset\.0\.object'; did you mean 'objects'"),
        ("limit = 0", r"'dataset\.0\.limit' is 0"),
    ],
)
def test_what_is_not_there_is_told(data_set, selection, reason):
    with pytest.raises(HandbenchError, match=reason):
        found(data_set, selection)


def test_a_data_set_lies_inside_the_benchmark_s_folder(data_set):
    (data_set / "inner").mkdir(exist_ok=True)
    (data_set / "inner" / "b.toml").write_text(
        BENCH.replace("SELECTION", "").replace('"maroon"', '"../maroon"')
    )
    with pytest.raises(HandbenchError, match="leaves the folder"):
        load_benchmark(str(data_set / "inner" / "b.toml"))


def test_the_files_of_the_page_are_read():
    page = (Path(__file__).parents[3] / "docs" / "maroon.md").read_text("utf-8")
    bench, mapping, more = (
        tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    )
    assert BenchFile.model_validate(bench).dataset[0].distances == (30,)
    assert (
        PairsMapping.model_validate(more.pop("pairs")).first == 1
    )  # of samples by pair, which these are not
    told = Mapping.model_validate({**mapping, "rx": mapping["tx"], **more})
    assert (
        told.samples.reversed
        and told.array[0].datasets == ["tx2", "rx2", "xr2"]
        and told.wave_speed_m_s == 1e8
    )


def test_what_opens_a_folder(data_set, tmp_path):
    native = open_capture(data_set / "native")
    assert native.about == load(
        CaptureFile, data_set / "native" / "capture.toml", "a capture description"
    )
    assert native.truth == data_set / "native" / "truth.ply"
    assert (native.mesh(), native.photos, native.transform()) == (None, None, None)
    with pytest.raises(HandbenchError, match="only captures of MAROON have frames @emptyfiltered"):
        open_capture(data_set / "native@emptyfiltered")
    with pytest.raises(
        HandbenchError, match=r"expected capture\.toml \(handbench\), mapping\.toml"
    ):
        open_capture(tmp_path)
    with pytest.raises(HandbenchError, match="expected a folder with a capture, found nothing"):
        open_capture(tmp_path / "nowhere")
    (tmp_path / "scan.npy").touch()
    with pytest.raises(HandbenchError, match="run `handbench import planar_scan`"):
        open_capture(tmp_path)
