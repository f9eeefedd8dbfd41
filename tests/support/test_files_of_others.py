"""Files, names and machines of others: what is right is read, and the rest is named."""

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
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.photos.photos import find_photos
from handbench.radar.data.arrays import load_positions
from handbench.support.config import checked_name, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_json, write_text
from handbench.support.hdf5 import attribute

CSV = "x_m,y_m,z_m\n0.5,0,0\n-0.5,0,0.25\n"
OBJ = "v 0 0 0.5\nv 1 0 0.5\nv 0 1 0.5\nf 1 2 3\n"
COMPOSED = unicodedata.normalize("NFC", "Prüfkörper")
TAKEN_APART = unicodedata.normalize("NFD", COMPOSED)


def toml(path):
    return read_toml(path, "a table")


def json(path):
    return read_json(path, "an object")


@pytest.mark.parametrize(
    ("read", "name", "content"),
    [
        (toml, "a.toml", b"\xef\xbb\xbfa = 1\r\n"),
        (json, "a.json", b'\xef\xbb\xbf{"a": 1}'),
        (load_positions, "a.csv", f"\ufeff{CSV}".encode()),
        (load_positions, "a.csv", CSV.replace(",", ", ").encode()),
        (load_positions, "a.csv", CSV.replace("\n", "\r").encode()),
        (read_triangles, "a.obj", OBJ.replace("\n", "\r").encode()),
    ],
)
def test_marks_and_ends_of_lines_change_nothing(tmp_path, read, name, content):
    (tmp_path / name).write_bytes(content)
    found = read(tmp_path / name)
    assert len(found[0] if isinstance(found, tuple) else found) in (1, 2, 3)


@pytest.mark.parametrize(
    ("read", "name", "content", "words"),
    [
        (load_positions, "a.csv", CSV.replace(",", ";").encode(), "separated by commas"),
        (load_positions, "a.csv", CSV.encode("utf-16"), "utf-8"),
        (toml, "a.toml", b"a = 1\nb = 0,3\n", "'b = 0,3'"),
        (toml, "a.toml", b"a = 1\nb = '\xfc'", "utf-8"),
        (json, "a.json", b'{"a": 1,\n"b": 0,3}', '"b": 0,3}'),
    ],
)
def test_the_place_of_a_fault_in_a_text_is_shown(tmp_path, read, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(HandbenchError) as caught:
        read(tmp_path / name)
    assert words in str(caught.value) and name in str(caught.value)


@pytest.mark.parametrize("value", [3, np.bytes_(b"text")])
def test_an_attribute_in_an_array_of_one_is_that_attribute(tmp_path, value):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["plain"], file.attrs["list"] = value, [value]
        assert attribute(file, "plain") == attribute(file, "list")


def photographs(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for k, name in enumerate(names):
        picture = Image.fromarray(np.full((20, 30), k, np.uint8))
        picture.save(os.fsencode(folder) + b"/" + os.fsencode(name), format="PNG")
    return folder


def test_names_of_photographs_have_one_readable_form(tmp_path):
    names = [f"{TAKEN_APART}.png", "m\udcfcller.png", "b.png", "d.webp"]
    photos = find_photos(photographs(tmp_path / "p", names))
    assert [photo.name for photo in photos] == [f"{COMPOSED}.png", "b.png", "m\\xfcller.png"]
    assert all(photo.path.is_file() for photo in photos)


@pytest.mark.parametrize("stored", [COMPOSED, TAKEN_APART])
def test_a_file_is_found_by_either_form_of_its_name(stored, tmp_path):
    (tmp_path / stored).touch()
    for asked in (COMPOSED, TAKEN_APART):
        assert inside(tmp_path, asked, "maps") == (tmp_path / stored).resolve()
        assert checked_name(asked) == COMPOSED
    for name in (f"../{stored}", "a/" * 600, "a" * 300, "a\0b"):
        with pytest.raises(HandbenchError, match="maps: "):
            inside(tmp_path, name, "maps")


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
    def missing(*_, **__):
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    photos = photographs(tmp_path / "p", ["a.png", "b.png", "c.png"])
    monkeypatch.setattr(tempfile, "mkdtemp", missing)
    monkeypatch.setattr(tempfile, "gettempdir", missing)
    assert main(["groundtruth", str(photos), "-o", str(tmp_path / "m.ply"), "--unscaled"]) == 2
    assert "set TMPDIR" in capsys.readouterr().err.splitlines()[-1]
