"""What a command leaves on terminals, in pictures and on the disk, however it ends."""

import fcntl
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import handbench
from handbench.bench.datasets import simulated
from handbench.bench.results.maps import SurfaceMap
from handbench.cli.main import main
from handbench.reports.figures.layers import depth_layers, layers_figure
from handbench.reports.figures.style import image_bytes
from handbench.support.files import free, write_text
from handbench.support.progress import print_json, print_lines, say
from tests.refusals import refuse, refuse_command

EVIL = "\x1b]0;title\x07\nhandbench: all is well\x9b2J\u202e"
SHOWN = r"\x1b]0;title\x07\nhandbench: all is well\x9b2J\u202e"


def picture(title: str) -> bytes:
    surface = SurfaceMap(np.arange(3.0), np.arange(3.0), np.ones((3, 3)))
    return image_bytes(layers_figure(depth_layers(surface, {}), title))


def test_what_a_terminal_obeys_is_shown_as_text(capsys):
    print_lines(EVIL)
    say(EVIL)
    assert capsys.readouterr() == (SHOWN + "\n", SHOWN + "\n")
    print_json([EVIL, "−"])
    printed = capsys.readouterr().out
    refuse_command(["show", "depth.npz", EVIL], SHOWN)
    assert json.loads(printed) == [EVIL, "−"] and printed.replace("\n", "").isprintable()
    assert picture(EVIL.replace("\n", "")) == picture(SHOWN.replace(r"\n", ""))
    picture("手")  # without matplotlib's warning


def test_pictures_take_nothing_of_the_user_s_settings(made, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "junk")
    assert main(["show", str(made / "depth.npz"), "-o", str(tmp_path / "a.pdf")]) == 0
    wanted = picture("a_b")
    with matplotlib.rc_context({"text.usetex": True, "savefig.bbox": "tight", "font.size": 20}):
        assert picture("a_b") == wanted


def test_streams_that_are_closed_are_the_null_device(monkeypatch):
    closed = ["bash", "-c", 'exec "$@" <&- >&- 2>&-', "-", sys.executable, "-m", "handbench"]
    assert subprocess.run([*closed, "list", "metrics"]).returncode == 0
    for stream in (None, type("W", (), {"write": io.StringIO().write})()):
        monkeypatch.setattr(sys, "stderr", stream)
        say("nobody reads this")


def test_a_deleted_current_folder_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    refuse_command(["list"], "current folder")
    monkeypatch.undo()  # which cannot return later


def test_names_that_a_disk_cannot_hold_are_refused_and_others_written(tmp_path):
    for name in ("n" * 250, "手" * 80 + ".txt"):
        write_text(tmp_path / name, name)
        assert (tmp_path / name).read_text() == name
    for name in ("p/" * 2250, "a\0b"):
        refuse(lambda name=name: write_text(tmp_path / name, ""), str(tmp_path))
    refuse(lambda: write_text("/dev/null", ""), "/dev/null")
    (tmp_path / "link").symlink_to("nowhere")
    refuse(lambda: free(False, tmp_path / "link"), "link")
    refuse_command(["run", "", "-o", str(tmp_path / "out")], "''")
    (tmp_path / "circle").symlink_to("circle")
    refuse_command(["show", str(tmp_path / "circle")], "circle")


def turned_into_another(number):
    """As the import of a C extension does."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt:
        raise ImportError from None


def ignored(number):
    class Called:
        def __del__(self):
            signal.raise_signal(number)

    Called()
    time.sleep(9)


@pytest.mark.parametrize("how", [signal.raise_signal, turned_into_another, ignored])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_is_ended_leaves_nothing(made, tmp_path, monkeypatch, capsys, how, number):
    signal.signal(number, signal.SIG_DFL)  # nohup ignores one of them
    monkeypatch.setattr(simulated, "echoes", lambda *_: how(number))
    scene = made / "bench" / "ball.toml"
    assert main(["simulate", str(scene), "-o", str(tmp_path / "cap")]) == 128 + number
    assert not list(tmp_path.iterdir()) and "Error" not in capsys.readouterr().err


def test_what_a_killed_command_left_is_removed_by_the_next(tmp_path):
    ends = ("0.handbench", "1.handbench", "mine")
    living, dead, other = (tmp_path / f".a.txt-{end}" for end in ends)
    for folder in (living, dead, other):
        folder.mkdir()
    lock = os.open(living, os.O_DIRECTORY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    write_text(tmp_path / "a.txt", "")
    os.close(lock)
    assert {path.name for path in tmp_path.iterdir()} == {"a.txt", living.name, other.name}


def test_a_clone_is_a_package_without_an_installation():
    assert any((Path(place) / "bench").is_dir() for place in handbench.__path__)
