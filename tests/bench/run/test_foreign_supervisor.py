"""A foreign program's processes, output and files: nothing that it does or leaves hangs or ends
handbench, and nothing outlives it."""

import os
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import pytest

from handbench.bench.run import foreign, supervisor
from handbench.support.errors import HandbenchError

GUARD_S = 300  # before a test gives up
DAEMON = """
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            open({file!r}, "w").write(str(os.getpid()))
            time.sleep(1000)
        os._exit(0)
    while not (os.path.exists({file!r}) and open({file!r}).read()):
        time.sleep(0.01)
"""


@pytest.fixture
def room(tmp_path):
    (tmp_path / "room").mkdir()
    return tmp_path / "room"


def command(tmp_path, program: str) -> list[str]:
    file = tmp_path / "mine.py"
    file.write_text("import os, signal, sys, time\n" + textwrap.dedent(program))
    return [sys.executable, str(file)]


def wait_until(true):
    end_s = time.monotonic() + GUARD_S
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def ended(process: str) -> bool:
    """Whether a process has gone, or is dead and not yet waited for."""
    with suppress(FileNotFoundError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return True


def test_a_daemon_that_keeps_the_output_open_ends_with_the_program(room, tmp_path):
    daemon = tmp_path / "daemon.txt"
    foreign._run(command(tmp_path, DAEMON.format(file=str(daemon))), room, 600.0, 0)
    assert ended(daemon.read_text())


PROGRAMS = {
    "it kills its group": ("os.kill(0, signal.SIGTERM); time.sleep(1000)", "exit code 143"),
    "it kills its parent": ("os.kill(os.getppid(), signal.SIGKILL)", "exit code -9"),
    "it deletes its folder": (
        "import shutil; shutil.rmtree(os.getcwd()); sys.exit('no antenna')",
        "its last line: no antenna",
    ),
    "it prints 64 MB": (
        "for n in range(64): os.write(1, b'x' * 2**20)\nsys.exit('\\nat the end')",
        "exit code 1; its last line: at the end",
    ),
    "it writes beyond its limit": (
        "open('big', 'wb').truncate(2**33 + 1)",
        "its last line: OSError: .* File too large",
    ),
}


@pytest.mark.parametrize(("program", "words"), PROGRAMS.values(), ids=PROGRAMS)
def test_what_it_does_to_others_is_one_line(room, tmp_path, program, words):
    with pytest.raises(HandbenchError, match=words):
        foreign._run(command(tmp_path, program), room, 600.0, 2**13)


def test_of_its_output_only_the_end_is_kept(tmp_path):
    given = command(tmp_path, "os.write(1, b'x' * 2**20); os.write(1, b'end')")
    above = [sys.executable, "-IS", supervisor.__file__, str(os.getpid()), str(tmp_path), "0"]
    found = subprocess.run([*above, *given], capture_output=True, check=True)
    assert len(found.stdout) == 4096 and found.stdout.endswith(b"xend") and not found.stderr


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL], ids=["SIGTERM", "SIGKILL"])
def test_it_ends_with_handbench_and_its_folder_is_deleted(room, tmp_path, end):
    daemon = tmp_path / "daemon.txt"
    given = command(tmp_path, DAEMON.format(file=str(daemon)) + "    time.sleep(1000)\n")
    ours = f"""
        from pathlib import Path
        from handbench.bench.run import foreign
        foreign._run({given!r}, Path({str(room)!r}), 600.0, 0)
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(ours)]) as process:
        wait_until(lambda: daemon.exists() and daemon.read_text())
        process.send_signal(end)
    wait_until(lambda: ended(daemon.read_text()) and not room.exists())


def test_a_folder_that_cannot_be_deleted_is_named(tmp_path, capsys):
    deep, here = tempfile.mkdtemp(dir=tmp_path), os.open(".", os.O_RDONLY)
    os.chdir(deep)
    try:
        for _ in range(1500):  # deeper than Python's recursion
            os.mkdir("d")
            os.chdir("d")
        foreign._delete(Path(deep))
    finally:
        os.fchdir(here)
        os.close(here)
    assert f"{deep}: could not be deleted completely" in capsys.readouterr().err
    subprocess.run(["rm", "-rf", deep], check=True)
