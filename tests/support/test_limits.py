"""Files that cost more than they weigh are refused in words, and those at the limits are read."""

import os
import zipfile
import zlib

import h5py
import numpy as np
import pytest

from handbench.groundtruth.pictures import open_picture
from handbench.radar.data.arrays import AntennaArray, load_positions
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support import files
from handbench.support.config import read_toml
from handbench.support.files import read_bytes, read_json, read_npz, write_npz
from tests.refusals import refuse


def read_keys(path):
    return read_toml(path, "keys")


def read_lists(path):
    return read_json(path, "lists")


def lists(levels):
    return "[" * levels + "0" + "]" * levels


def antennas(count):
    return "x_m,y_m,z_m\n" + "0,0,0\n" * count


@pytest.mark.parametrize(
    ("read", "right", "wrong"),
    [
        (read_lists, lists(files.DEEPEST - 1), lists(files.DEEPEST + 1)),
        (read_keys, f"a = {lists(files.DEEPEST - 1)}", f"a = {lists(files.DEEPEST + 1)}"),
        (read_lists, f"[{'0,' * 199_999}0]", f"[{'0,' * 200_000}0]"),
        (read_keys, ".".join("a" * 20) + " = 1", ".".join("a" * 33) + " = 1"),
        (read_keys, "#", "#" * (files.TOML_BYTES + 1)),
        (load_positions, antennas(2000), antennas(2001)),
    ],
    ids=["nested JSON", "nested TOML", "values", "key", "bytes", "antennas"],
)
def test_a_text_at_the_limit_is_read_and_one_beyond_is_refused(tmp_path, read, right, wrong):
    (tmp_path / "a").write_text(right)
    read(tmp_path / "a")
    (tmp_path / "a").write_text(wrong)
    refuse(lambda: read(tmp_path / "a"), str(tmp_path / "a"))


def test_an_archive_has_so_many_members(tmp_path):
    write_npz(tmp_path / "a.npz", x=np.arange(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        for k in range(files.MOST_MEMBERS - 1):
            archive.writestr(f"m{k}", b"")
    assert read_npz(tmp_path / "a.npz", ("x",))["x"].tolist() == [0, 1, 2]
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("one more", b"")
    refuse(lambda: read_npz(tmp_path / "a.npz", ("x",)), "a.npz", str(files.MOST_MEMBERS))


@pytest.mark.parametrize("size, fits", [(64, True), (2**26, False)])
def test_pieces_that_unpack_to_more_than_they_are_are_refused(tmp_path, size, fits):
    path, piece = tmp_path / "echoes.h5", (1, 2, 2, 2)
    array = AntennaArray(np.eye(3)[:2], np.eye(3)[:2])
    save_capture(path, RadarCapture(np.ones(piece, np.complex64), np.array([1e9, 2e9]), array))
    with h5py.File(path, "a") as file:
        del file["samples"]
        made = file.create_dataset("samples", piece, "c8", chunks=piece, compression="gzip")
        made.id.write_direct_chunk((0, 0, 0, 0), zlib.compress(bytes(size), 9))
    if fits:
        assert not load_capture(path).samples.any()
        return
    refuse(lambda: load_capture(path), str(path), "'samples'")


def test_what_has_no_end_is_not_waited_for(tmp_path):
    assert read_bytes("/proc/self/maps", "text", 2**20) == b""  # its size says so
    os.mkfifo(tmp_path / "a.png")
    refuse(lambda: open_picture(tmp_path / "a.png").__enter__(), "a.png")
