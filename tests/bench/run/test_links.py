"""Result folders that a stranger has prepared: no link in them is followed, nothing outside is
read, cut or deleted."""

import os
import shutil
import socket
from pathlib import Path

import pytest

from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.bench.tradeoff.run import run as tradeoff
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash
from handbench.support.folder import MARKER, drop, locked
from handbench.support.store import MANIFEST, Stage, cached
from tests.bench.run.faults import content, instant

NAMES = (
    *(
        MARKER,
        "work",
        "errors",
        "depth",
        "photos",
        "settings",
        "result.json",
        "table.csv",
        "tasks.csv",
    ),
    *("config.toml", "tradeoff.json", "tradeoff.csv", ".table-abc", ".errors-abc"),
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


def attack(out: Path, name: str, target: str | Path) -> Path:
    """A run's folder with a link, or what else stands there, in the place of one of its files or
    folders."""
    place = out / name
    (out / "work").mkdir(parents=True) if name != "work" else out.mkdir()
    if name != MARKER:
        (out / MARKER).touch()
    if target == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(target)
    return place


@pytest.mark.parametrize("sweep", [False, True], ids=["run", "tradeoff"])
@pytest.mark.parametrize("to", ["folder", "file", "nothing", "pipe"])
@pytest.mark.parametrize("name", NAMES)
def test_a_link_in_a_run_s_folder_is_refused_and_not_followed(
    small_bench, home, unharmed, tmp_path, name, to, sweep
):
    target = {"folder": home, "file": home / "secret", "nothing": home / "new", "pipe": "pipe"}[to]
    place = attack(tmp_path / "out", name, target)
    bench, base = load_benchmark(str(small_bench))
    what = "neither a file nor a folder" if to == "pipe" else "a link"
    with pytest.raises(
        HandbenchError, match=f"{place.name}: is {what}, which no run wrote; it stays unchanged"
    ):
        (tradeoff if sweep else run)(bench, base, tmp_path / "out", overwrite=True)
    assert os.path.lexists(place)


def test_a_link_to_a_pipe_is_not_waited_for(small_bench, home, unharmed, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    bench, base = load_benchmark(str(small_bench))
    for number, name in enumerate(NAMES):
        attack(tmp_path / f"out{number}", name, tmp_path / "pipe")
        with pytest.raises(HandbenchError, match="is a link"):
            run(bench, base, tmp_path / f"out{number}")


def test_files_of_a_kept_stage_that_became_links_are_made_again(
    small_bench, home, unharmed, tmp_path, monkeypatch
):
    bench, base = load_benchmark(str(small_bench))
    run(bench, base, tmp_path / "clean")
    instant(tmp_path / "clean", monkeypatch)
    out, expected = tmp_path / "out", content(tmp_path / "clean")
    for name in ("depth.npz", MANIFEST, "stage.json"):
        for other in ("link", "pipe", "folder", "socket"):
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(tmp_path / "clean", out)
            [place] = (out / "work").glob(f"reconstruct-ball-2fsk-*/{name}")
            place.unlink()
            if other == "link":
                shutil.copyfile(
                    next((tmp_path / "clean" / "work").glob(f"reconstruct-ball-2fsk-*/{name}")),
                    out / "same",
                )
                place.symlink_to(out / "same")
            elif other == "folder":
                place.symlink_to(home)
            elif other == "pipe":
                os.mkfifo(place)
            else:
                monkeypatch.chdir(place.parent)  # its whole path is too long for a socket
                with socket.socket(socket.AF_UNIX) as made:
                    made.bind(place.name)
                monkeypatch.chdir(tmp_path)
            made = run(bench, base, out).tasks.query("not cached").task.tolist()
            assert made == ["reconstruct-ball-2fsk"]
            (out / "same").unlink(missing_ok=True)
            assert content(out) == expected


def test_a_stage_s_folder_that_became_a_link_is_refused(tmp_path, home, unharmed, monkeypatch):
    monkeypatch.setattr("handbench.support.code_hash.key_of", lambda module: module)
    one = Stage("dense", print, {}, [])
    (tmp_path / "stages").mkdir()
    one.folder(tmp_path / "stages").symlink_to(home)
    with pytest.raises(HandbenchError, match="is a link"):
        cached(tmp_path / "stages", one)
    (tmp_path / "linked").symlink_to(home)
    with pytest.raises(HandbenchError, match="linked: is a link"):
        cached(tmp_path / "linked", one)
    with (
        pytest.raises(HandbenchError, match="a link is in the folder's place"),
        atomic_folder(tmp_path / "linked"),
    ):
        pass
    assert (tmp_path / "linked").is_symlink()


def test_what_belongs_to_somebody_else_is_left_alone(tmp_path, monkeypatch):
    with locked(tmp_path / "out"):
        pass
    (tmp_path / "out" / "table.csv").write_text("theirs")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 4711)
    with (
        pytest.raises(HandbenchError, match=r"is another user's \(number \d+\)"),
        locked(tmp_path / "out"),
    ):
        pass
    with pytest.raises(HandbenchError, match=r"table\.csv: is another user's"):
        drop(tmp_path / "out", ["table.csv"])
    assert (tmp_path / "out" / "table.csv").read_text() == "theirs"


def test_the_folder_s_own_path_may_lead_through_links(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "runs").symlink_to(tmp_path / "disk")
    with locked(tmp_path / "runs") as work:
        assert work.is_dir()
    with locked(tmp_path / "runs" / "new"):
        pass
    assert (tmp_path / "disk" / "new" / MARKER).is_file()


def test_a_capture_s_hash_takes_regular_files_alone(tmp_path, home, unharmed):
    capture = tmp_path / "capture"
    (capture / "photos").mkdir(parents=True)
    (capture / "photos" / "a.jpg").write_text("a")
    (capture / "copy.jpg").symlink_to(capture / "photos" / "a.jpg")
    before = content_hash(capture)
    (capture / "copy.jpg").unlink()
    (capture / "copy.jpg").write_text("a")  # a link inside counts with the file's content
    assert content_hash(capture) == before
    for target in (home / "secret", home, "round", capture / "photos", capture / "nothing"):
        (capture / "round").symlink_to(target)
        with pytest.raises(HandbenchError, match="round: is a link that leads to no file inside"):
            content_hash(capture)
        (capture / "round").unlink()
    os.mkfifo(capture / "pipe")
    for asked in (capture, capture / "pipe", Path("/dev/zero")):
        with pytest.raises(HandbenchError, match="is not a readable file"):
            content_hash(asked)
