"""Result folders that a stranger has prepared: no link in them is followed, nothing outside is
read, cut or deleted."""

import os
import shutil
from pathlib import Path

import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash
from handbench.support.folder import MARKER, drop, locked
from handbench.support.store import cached
from tests.bench.run.faults import content, instant
from tests.bench.run.stages_of_tests import stages_of

NAMES = (
    *(MARKER, "work", "errors", "depth", "photos", "result.json", "table.csv"),
    *("tasks.csv", "config.toml", ".table-abc", ".errors-abc"),
    *("work/simulate-ball-0123456789abcdef", "work/.simulate-ball-abc"),
)


@pytest.fixture
def home(tmp_path) -> Path:
    """Somebody's folder, with hidden folders of such names as killed runs leave."""
    folder = tmp_path / "home"
    for name in (".mail-box/letters", "errors/mine"):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text("precious")
    (folder / "secret").write_text("version = 'precious'")
    return folder


@pytest.fixture
def unharmed(home):
    before = content(home)
    yield
    assert content(home) == before and len(before) == 3


def test_a_stage_s_folder_that_became_a_link_is_refused(tmp_path, home, unharmed):
    [one] = stages_of("a")
    (tmp_path / "stages").mkdir()
    one.folder(tmp_path / "stages").symlink_to(home)
    with pytest.raises(HandbenchError, match="is a link"):
        cached(tmp_path / "stages", one)
    (tmp_path / "linked").symlink_to(home)
    with pytest.raises(HandbenchError, match="linked: is a link"):
        cached(tmp_path / "linked", one)
    with pytest.raises(HandbenchError, match="Not a directory"), atomic_folder(tmp_path / "linked"):
        pass
    assert (tmp_path / "linked").is_symlink()


def test_what_belongs_to_somebody_else_is_left_alone(tmp_path, monkeypatch):
    with locked(tmp_path / "out"):
        pass
    (tmp_path / "out" / "table.csv").write_text("theirs")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 4711)
    with pytest.raises(HandbenchError, match="belongs to another user"), locked(tmp_path / "out"):
        pass
    with pytest.raises(HandbenchError, match=r"table\.csv: .*belongs to another user"):
        drop(tmp_path / "out", ["table.csv"])
    assert (tmp_path / "out" / "table.csv").read_text() == "theirs"


@pytest.mark.parametrize("to", ["folder", "file", "nothing", "pipe", "link to a pipe"])
def test_a_link_in_a_run_s_folder_is_refused_and_not_followed(
    small_bench, home, unharmed, tmp_path, to
):
    """In the place of any of its files or folders, or a pipe itself, which is not waited for."""
    bench, base = load_benchmark(str(small_bench))
    os.mkfifo(tmp_path / "pipe")
    targets = {"folder": home, "file": home / "secret", "nothing": home / "new"}
    for number, name in enumerate(NAMES):
        out = tmp_path / f"out{number}"
        (out / name).parent.mkdir(parents=True)
        if name != MARKER:
            (out / MARKER).touch()
        if to == "pipe":
            os.mkfifo(out / name)
        else:
            (out / name).symlink_to(targets.get(to, tmp_path / "pipe"))
        words = f"{(out / name).name}: is a link or a device"
        with pytest.raises(HandbenchError, match=words):
            run(bench, base, out, overwrite=True)
        assert os.path.lexists(out / name)


@pytest.mark.parametrize("other", ["link", "folder", "pipe"])
def test_files_of_a_kept_stage_that_became_links_are_made_again(
    small_bench, small_result, home, unharmed, tmp_path, monkeypatch, other
):
    bench, base = load_benchmark(str(small_bench))
    instant(small_result, monkeypatch)
    out, expected = tmp_path / "out", content(small_result)
    shutil.copytree(small_result, out)
    for name in ("depth.npz", "stage.json"):
        [place] = (out / "work").glob(f"reconstruct-ball-2fsk-*/{name}")
        if other == "link":
            place.rename(out / "same")
            place.symlink_to(out / "same")
        else:
            place.unlink()
        if other == "folder":
            place.symlink_to(home)
        elif other == "pipe":
            os.mkfifo(place)
        made = run(bench, base, out).tasks.query("not cached").task.tolist()
        assert made == ["reconstruct-ball-2fsk"]
        (out / "same").unlink(missing_ok=True)
        assert content(out) == expected


def test_a_capture_s_hash_takes_regular_files_alone(tmp_path, home, unharmed):
    capture = tmp_path / "capture"
    (capture / "photos").mkdir(parents=True)
    (capture / "photos" / "a.jpg").write_text("a")
    (capture / "copy.jpg").symlink_to(capture / "photos" / "a.jpg")
    before = content_hash(capture)
    (capture / "copy.jpg").unlink()
    (capture / "copy.jpg").write_text("a")  # a link inside counts with the file's content
    assert content_hash(capture) == before
    for target in (home / "secret", "round", capture / "photos"):
        (capture / "round").symlink_to(target)
        with pytest.raises(HandbenchError, match="round: is a link to something outside"):
            content_hash(capture)
        (capture / "round").unlink()
    os.mkfifo(capture / "pipe")
    for asked in (capture, Path("/dev/zero")):
        with pytest.raises(HandbenchError, match="expected a regular file"):
            content_hash(asked)
