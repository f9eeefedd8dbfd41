"""Files and machines of others: marks, names, permissions, terminals."""

import errno
import io
import os
import sys
import tempfile
import unicodedata
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

from handbench.cli.main import main
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.options import Distance
from handbench.groundtruth.photos.photos import find_photos
from handbench.support.config import read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, read_json, write_text
from handbench.support.hdf5 import attribute

MARK = b"\xef\xbb\xbf"
COMPOSED = unicodedata.normalize("NFC", "münze.png")
TAKEN_APART = unicodedata.normalize("NFD", "münze.png")


def test_a_byte_order_mark_changes_no_toml_and_no_json(tmp_path):
    (tmp_path / "a.toml").write_bytes(MARK + b"a = 1\r\n")
    (tmp_path / "a.json").write_bytes(MARK + b'{"a": 1}')
    assert read_toml(tmp_path / "a.toml", "a table") == {"a": 1}
    assert read_json(tmp_path / "a.json", "an object") == {"a": 1}


@pytest.mark.parametrize("value", [3, np.bytes_(b"text")])
def test_an_attribute_in_an_array_of_one_is_that_attribute(tmp_path, value):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["plain"], file.attrs["list"] = value, [value]
        file.attrs["two"] = [1, 2]
        assert attribute(file, "plain") == attribute(file, "list")
        assert attribute(file, "two") is None


def photographs(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for k, name in enumerate(names):
        picture = Image.fromarray(np.full((20, 30), k, np.uint8))
        picture.save(os.fsencode(folder) + b"/" + os.fsencode(name), format="PNG")
    return folder


def test_names_are_compared_in_one_form(tmp_path):
    photos = find_photos(photographs(tmp_path / "p", [TAKEN_APART, "b.png", "c.png"]))
    camera = Camera(name=TAKEN_APART, width=30, height=20, params=(30, 30, 15, 10, 0, 0, 0, 0))
    distance = Distance(first=TAKEN_APART, second="b.png", distance_m=1)
    assert photos[-1].name == camera.name == distance.first == COMPOSED
    assert photos[-1].path.is_file()


def test_a_name_that_is_not_utf_8_has_a_readable_form(tmp_path):
    photos = find_photos(photographs(tmp_path / "p", ["m\udcfcller.png", "b.png", "c.png"]))
    assert [photo.name for photo in photos] == ["b.png", "c.png", "m%FCller.png"]
    assert one_form("a b.png") == "a b.png"


def test_two_photographs_of_one_name_are_refused(tmp_path):
    folder = photographs(tmp_path / "p", [TAKEN_APART, COMPOSED, "c.png"])
    with pytest.raises(HandbenchError, match="two photographs are called"):
        find_photos(folder)


def test_pictures_that_are_not_read_are_named(tmp_path, capsys):
    folder = photographs(tmp_path / "p", ["a.png", "b.png", "c.png", "d.webp", "e.bmp", "f.dng"])
    assert len(find_photos(folder)) == 3
    assert "d.webp and 2 more: left out, because it is not JPEG" in capsys.readouterr().err


def test_a_file_system_without_permissions_takes_files(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))

    monkeypatch.setattr(os, "chmod", refuse)
    write_text(tmp_path / "a.txt", "a")
    assert (tmp_path / "a.txt").read_text() == "a"


def test_a_latin_1_terminal_shows_help(monkeypatch):
    terminal = io.TextIOWrapper(io.BytesIO(), encoding="latin-1")
    monkeypatch.setattr(sys, "stdout", terminal)
    assert main(["list"]) == 0
    assert b"3fsk" in terminal.buffer.getvalue()


def test_no_folder_for_temporary_files_is_one_line(tmp_path, monkeypatch, capsys):
    photographs(tmp_path / "p", ["a.png", "b.png", "c.png"])

    def missing(*_, **__):
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr(tempfile, "mkdtemp", missing)
    monkeypatch.setattr(tempfile, "gettempdir", missing)
    given = ["groundtruth", str(tmp_path / "p"), "-o", str(tmp_path / "m.ply"), "--unscaled"]
    assert main(given) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("set TMPDIR to a writable folder")
