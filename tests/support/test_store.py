"""Stages that are kept: made once, found again, made anew when anything that they depend on is
another."""

from pathlib import Path

import pytest

from handbench.support import store
from handbench.support.errors import HandbenchError
from handbench.support.store import MANIFEST, STAMP, Stage, cached

made: list[str] = []


def make(folder: Path, end: BaseException | None = None) -> None:
    """Counts how often it was called."""
    made.append(str(end))
    (folder / "result.txt").write_text(f"made {len(made)}")
    if end is not None:
        raise end


@pytest.fixture
def of(monkeypatch):
    """A stage by its name and what it depends on; this module stands for one of the packages."""
    made.clear()
    monkeypatch.setattr(store.code_hash, "key_of", lambda module: module)
    return lambda name, inputs, **given: Stage(name, make, given, inputs)


def test_what_was_made_is_not_made_again(tmp_path, of):
    first = of("dense", ["a", 1, None])
    stamp, there = cached(tmp_path, first)
    assert not there and stamp.seconds >= 0 and stamp.machine["cores"] >= 1
    again = cached(tmp_path, of("dense", ["a", 1, None]))
    assert again == (stamp, True)  # what it cost when it was made
    assert len(made) == 1 and (first.folder(tmp_path) / "result.txt").read_text() == "made 1"
    assert {path.name for path in first.folder(tmp_path).iterdir()} == {
        "result.txt",
        STAMP,
        MANIFEST,
    }


@pytest.mark.parametrize("end", [KeyboardInterrupt(), ValueError(), HandbenchError("known")])
def test_a_stage_that_was_killed_leaves_nothing_and_is_made_again(tmp_path, of, end):
    with pytest.raises(type(end)):
        cached(tmp_path, of("dense", ["a"], end=end))
    assert not list(tmp_path.iterdir())
    assert not cached(tmp_path, of("dense", ["a"]))[1] and len(made) == 2


def test_changed_code_is_another_folder(of, monkeypatch):
    before = of("dense", ["a"])
    monkeypatch.setattr(store.code_hash, "key_of", lambda module: f"{module} changed")
    assert of("dense", ["a"]).key != before.key
    plugged = [Stage("dense", make, {}, ["a"], plugged=(code,)).key for code in ("one", "another")]
    assert len({before.key, *plugged}) == 3


@pytest.mark.parametrize("content", ["{}", "[]", '{"version": 2}', '{"other.txt": [1, 2]}', ""])
def test_an_empty_or_foreign_manifest_is_a_broken_one(tmp_path, of, capsys, content):
    stage = of("dense", ["a"])
    cached(tmp_path, stage)
    (stage.folder(tmp_path) / MANIFEST).write_text(content)
    assert not cached(tmp_path, stage)[1] and len(made) == 2
    assert f"the file {MANIFEST} is missing or damaged" in capsys.readouterr().err
