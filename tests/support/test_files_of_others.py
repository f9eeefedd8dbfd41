"""Files, names and machines of others: what is right is read, and the rest is named."""

import errno
import io
import os
import sys
import tempfile
import unicodedata
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import read_triangles
from handbench.groundtruth.photos import find_photos
from handbench.radar.data.arrays import load_positions
from handbench.radar.data.hdf5 import attribute
from handbench.support.config import checked_name, read_toml
from handbench.support.files import inside, read_json, write_text
from tests.refusals import refuse, refuse_command

CSV = "x_m,y_m,z_m\n0.5,0,0\n-0.5,0,0.25\n"
OBJ = "v 0 0 0.5\nv 1 0 0.5\nv 0 1 0.5\nf 1 2 3\n"
COMPOSED = unicodedata.normalize("NFC", "Prüfkörper")
TAKEN_APART = unicodedata.normalize("NFD", COMPOSED)


@pytest.mark.parametrize(
    ("read", "plain", "marked"),
    [
        (partial(read_toml, what="a table"), "a = 1\n", "\ufeffa = 1\r\n"),
        (partial(read_json, what="an object"), '{"a": 1}', '\ufeff{"a": 1}'),
        (load_positions, CSV, f"\ufeff{CSV}"),
        (load_positions, CSV, CSV.replace(",", ", ")),
        (load_positions, CSV, CSV.replace("\n", "\r")),
        (read_triangles, OBJ, OBJ.replace("\n", "\r")),
    ],
)
def test_marks_and_ends_of_lines_change_nothing(tmp_path, read, plain, marked):
    contents = []
    for text in (plain, marked):
        (tmp_path / "a.obj").write_bytes(text.encode())
        contents.append(read(tmp_path / "a.obj"))
    assert repr(contents[0]) == repr(contents[1])


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
    names = [f"{TAKEN_APART}.png", "m\udcfcller.png", "b.png", "d.txt"]
    photos = find_photos(photographs(tmp_path / "p", names))
    assert [photo.name for photo in photos] == [f"{COMPOSED}.png", "b.png", "m\\xfcller.png"]
    assert all(photo.path.is_file() for photo in photos)


@pytest.mark.parametrize("stored", [COMPOSED, TAKEN_APART])
def test_a_file_is_found_by_either_form_of_its_name(stored, tmp_path):
    (tmp_path / stored).touch()
    for asked in (COMPOSED, TAKEN_APART):
        assert inside(tmp_path, asked, "maps") == (tmp_path / stored).resolve()
        assert checked_name(asked) == COMPOSED
    for name in ("a/" * 600, "a" * 300, "a\0b"):
        refuse(lambda name=name: inside(tmp_path, name, "maps"), "maps: ")


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


def test_no_folder_for_temporary_files_is_one_line(tmp_path, monkeypatch):
    def missing(*_, **__):
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    photos = photographs(tmp_path / "p", ["a.png", "b.png", "c.png"])
    monkeypatch.setattr(tempfile, "mkdtemp", missing)
    monkeypatch.setattr(tempfile, "gettempdir", missing)
    refuse_command(
        ["groundtruth", str(photos), "-o", str(tmp_path / "m.ply"), "--unscaled"], "TMPDIR"
    )
