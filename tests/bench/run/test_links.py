"""Result folders that a stranger has prepared: no link in them is followed, nothing outside is
read, cut or deleted."""

import os
from pathlib import Path

import pytest

from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash
from handbench.support.store import MARKER, cached, drop, locked
from tests.bench.run.faults import content
from tests.bench.run.stages_of_tests import stages_of
from tests.refusals import refuse


@pytest.fixture
def home(tmp_path):
    """Somebody's folder, with hidden folders of such names as killed runs leave, unharmed."""
    folder = tmp_path / "home"
    for name in (".mail-box/letters", "errors/mine"):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text("precious")
    (folder / "secret").write_text("version = 'precious'")
    before = content(folder)
    yield folder
    assert content(folder) == before and len(before) == 3


def test_a_stage_s_folder_that_became_a_link_is_refused(tmp_path, home):
    [one] = stages_of("a")
    (tmp_path / "stages").mkdir()
    one.folder(tmp_path / "stages").symlink_to(home)
    refuse(lambda: cached(tmp_path / "stages", one), str(one.folder(tmp_path / "stages")))
    (tmp_path / "linked").symlink_to(home)
    refuse(lambda: cached(tmp_path / "linked", one), "linked")
    with pytest.raises(HandbenchError), atomic_folder(tmp_path / "linked"):
        pass
    assert (tmp_path / "linked").is_symlink()


def test_what_belongs_to_somebody_else_is_left_alone(tmp_path, monkeypatch):
    out = tmp_path / "out"
    with locked(out):
        pass
    (out / "table.csv").write_text("theirs")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 4711)
    refuse(lambda: locked(out).__enter__(), str(out))
    refuse(lambda: drop(out, ["table.csv"]), f"{out}/table.csv")
    assert (out / "table.csv").read_text() == "theirs"


@pytest.mark.parametrize(
    "name", [MARKER, "work", ".table-abc", "work/simulate-ball-0", "work/.a-b"]
)
@pytest.mark.parametrize("put", [Path.symlink_to, lambda path, _: os.mkfifo(path)])
def test_a_link_or_a_pipe_in_a_run_s_folder_is_refused(home, tmp_path, name, put):
    """In the place of any of its files or folders; a pipe is not waited for."""
    place = tmp_path / "out" / name
    place.parent.mkdir(parents=True)
    if name != MARKER:
        (tmp_path / "out" / MARKER).touch()
    put(place, home)
    refuse(lambda: locked(tmp_path / "out").__enter__(), str(place))
    assert os.path.lexists(place)


def test_a_capture_s_hash_takes_regular_files_alone(tmp_path, home):
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
        refuse(lambda: content_hash(capture), "round")
        (capture / "round").unlink()
    os.mkfifo(capture / "pipe")
    refuse(lambda: content_hash(capture), "pipe")
    refuse(lambda: content_hash(Path("/dev/zero")), "/dev/zero")
