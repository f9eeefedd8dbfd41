"""Errors, strict configuration and atomic files."""

from __future__ import annotations

import errno
import io
import os
import pickle
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field

from handbench.radar.data.arrays import load_positions
from handbench.support.config import Config, parse, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    atomic_folder,
    atomic_path,
    content_hash,
    free,
    inside,
    read_json,
    read_npz,
    require_file,
    require_folder,
    write_json,
)
from tests.refusals import refuse


class Part(Config):
    width_m: float = Field(default=0.1, gt=0)


class Scene(Config):
    name: str
    part: tuple[Part, ...] = ()


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    ("values", "places"),
    [
        ({"nmae": "a"}, ["'nmae'", "'name'"]),
        ({"name": "a", "part": [{}, {"widht_m": 1}]}, ["'part.1.widht_m'", "'width_m'"]),
        ({"name": "a", "zzzzzz": 1}, ["name, part"]),
        ({}, ["'name'"]),
        ({"name": 5}, ["'name' is 5"]),
        ({"name": "a", "part": [{"width_m": -1}]}, ["'part.0.width_m' is -1", "greater than 0"]),
        ({"name": "a", "b\nc": 1}, [r"'b\nc'"]),
        ({"name": 1, "part": [{"width_m": 0}] * 4}, ["; and 1 more"]),
    ],
)
def test_a_wrong_configuration_is_one_line_that_names_the_key(values, places):
    refuse(lambda: parse(Scene, values, "scene.toml"), "scene.toml: ", *places)


def test_an_exception_and_a_full_disk_leave_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    with monkeypatch.context() as patch:
        patch.setattr("handbench.support.files.os.replace", full_disk)
        refuse(lambda: write_json(path, {"a": 1}), str(path), "No space left on device")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_folder_appears_complete_and_replaces_the_old_one(tmp_path):
    path = tmp_path / "run"
    for name in ("first", "second"):
        with atomic_folder(path) as temporary:
            (temporary / name).write_text(name)
            assert not (path / name).exists()
    assert [p.name for p in path.iterdir()] == ["second"]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("write", [atomic_path, atomic_folder])
def test_what_appears_while_a_command_works_is_kept(tmp_path, write):
    path = tmp_path / "out"
    free(False, path)
    with pytest.raises(HandbenchError), write(path):
        path.mkdir()
    assert path.is_dir() and list(tmp_path.iterdir()) == [path]


def test_a_failed_folder_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "run"
    path.mkdir()
    (path / "old").write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_folder(path) as temporary:
        (temporary / "half").write_text("half")
        raise ZeroDivisionError
    rename, calls = os.replace, []

    def second_rename_fails(source, target):
        calls.append(source)
        full_disk() if len(calls) == 2 else rename(source, target)

    def write() -> None:
        with atomic_folder(path):
            pass

    with monkeypatch.context() as patch:
        patch.setattr("handbench.support.files.os.replace", second_rename_fails)
        refuse(write, "No space left")
    assert (path / "old").read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/../../x", "up/x", "link"])
def test_a_name_that_leaves_its_folder_is_refused(tmp_path, name):
    folder = tmp_path / "capture"
    folder.mkdir()
    (folder / "up").symlink_to(tmp_path)
    (tmp_path / "secret").write_text("")
    (folder / "link").symlink_to(tmp_path / "secret")
    refuse(lambda: inside(folder, name, "capture.toml"), "capture.toml: ", name)
    for good in ("x.npy", "a/b", "a/../b", "..x"):
        assert inside(tmp_path, good, "capture.toml") == (tmp_path / good).resolve()


def stored(save, **arrays) -> bytes:
    buffer = io.BytesIO()
    save(buffer, **arrays)
    return buffer.getvalue()


toml = partial(read_toml, what="a scene")
json = partial(read_json, what="a file")
npz = partial(read_npz, names=("z_m",))
WHOLE = stored(np.savez_compressed, z_m=np.arange(1000.0))
TORN = WHOLE[:200] + b"\0" * 50 + WHOLE[250:]


@pytest.mark.parametrize(
    ("read", "content", "place"),
    [
        (toml, b"a = ", "TOML"),
        (toml, b"\xff\xfe\x00", "TOML"),
        (toml, b"a = 1\nb = 0,3\n", "'b = 0,3'"),
        (json, b"\xff\xfe", "JSON"),
        (json, b"9" * 10_000, "JSON"),
        (json, b'{"a": 1,\n"b": 0,3}', '"b": 0,3}'),
        (load_positions, b"x_m,y_m,z_m\n1,2,3\n1,2\n", "line 3"),
        (load_positions, b"x_m,y_m,z_m\n", "[n, 3]"),
        (npz, b"PK", ".npz"),
        (npz, TORN, ".npz"),
        (npz, stored(np.save, arr=np.zeros(3)), ".npz"),
        (partial(read_npz, names=("z_m", "x_m")), WHOLE, "no x_m"),
        (partial(require_file, what="photos"), None, "photos"),
        (partial(require_folder, what="photos"), b"", "photos"),
    ],
)
def test_what_a_file_is_not_is_named_in_one_line(tmp_path, read, content, place):
    if content is not None:
        (tmp_path / "a").write_bytes(content)
    refuse(lambda: read(tmp_path / "a"), str(tmp_path / "a"), place)


def test_json_holds_null_for_what_is_not_finite_and_plain_numbers(tmp_path):
    content = {
        "a": float("nan"),
        "b": [np.inf, np.float32(0.5)],
        "c": np.array([[1.0, -np.inf]]),
        4: np.int64(3),
        "flag": np.bool_(True),
    }
    write_json(tmp_path / "a.json", content)
    read = {"a": None, "b": [None, 0.5], "c": [[1.0, None]], "4": 3, "flag": True}
    assert read_json(tmp_path / "a.json", "a test") == read
    with pytest.raises(AttributeError):
        write_json(tmp_path / "b.json", {"a": object()})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


class Trap:
    """Unpickling it writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_pickled_arrays_are_refused_and_never_run(tmp_path):
    sprung = tmp_path / "sprung"
    np.savez(tmp_path / "a.npz", z_m=np.array([Trap(sprung)], dtype=object))
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Trap(sprung)))
    for name in ("a.npz", "b.npz"):
        refuse(lambda name=name: npz(tmp_path / name), name)
    assert not sprung.exists()


def test_a_folders_hash_changes_with_content_and_name_and_with_nothing_else(tmp_path):
    folder = tmp_path / "capture"
    (folder / "photos").mkdir(parents=True)
    file = folder / "photos" / "a"
    file.write_text("1")
    hashed = content_hash(folder)
    os.utime(file, (0, 0))
    shutil.copytree(folder, tmp_path / "copy")
    assert content_hash(tmp_path / "copy") == hashed == content_hash(folder)
    file.write_text("2")
    assert content_hash(folder) != hashed
    file.write_text("1")
    file.rename(folder / "photos" / "b")
    assert content_hash(folder) != hashed


def test_values_that_differ_hash_differently(tmp_path):
    (tmp_path / "a").write_text("a")
    long = np.zeros(5000)
    other = long.copy()
    other[2500] = 1  # numpy's text of a long array leaves the middle out
    values = [
        ("a",),
        ("a", "b"),
        ("ab",),
        (1,),
        ("1",),
        ({"a": 1},),
        ([1, 2],),
        (None,),
        (tmp_path / "a",),
        (np.zeros(4),),
        (np.zeros(4, np.float32),),
        (np.zeros((2, 2)),),
        ({"a": long},),
        ({"a": other},),
    ]
    hashes = [content_hash(*parts) for parts in values]
    assert len(set(hashes)) == len(values)
    assert content_hash({"b": 1, "a": np.float64(2)}) == content_hash({"a": 2.0, "b": 1})
    assert content_hash(long[::2]) == content_hash(long[::2].copy())
    with pytest.raises(TypeError, match="cannot hash a value of type object"):
        content_hash({"a": object()})
