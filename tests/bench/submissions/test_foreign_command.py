"""A foreign method: it sees the echoes alone, in an environment of its own, and its limits hold."""

import subprocess
import sys
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

from handbench.bench.datasets.native import CaptureFile, NativeCapture, save_capture_file
from handbench.bench.submissions import foreign
from handbench.bench.submissions.submission import Submission
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError

GRID = PixelGrid(np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3))
ABOUT = Submission(method="mine", benchmark="small", timing="command")
WRITE = """
    x, y = np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3)
    np.savez(sys.argv[2], x_m=x, y_m=y, z_m=np.full((3, 5), 0.3), amplitude_db=np.zeros((3, 5)), seconds=1e-4)
"""


@pytest.fixture
def capture(tmp_path):
    folder = tmp_path / "hand"
    folder.mkdir()
    samples = np.random.default_rng(1).normal(size=(2, 1, 2, 3)).astype(np.complex64)
    array = AntennaArray(np.eye(3)[:2] * 0.1, np.eye(3) * 0.1)
    save_capture(folder / "echoes.h5", RadarCapture(samples, np.array([80e9]), array))
    (folder / "truth.ply").write_text("secret")
    save_capture_file(folder, CaptureFile(name="hand", pose="F", seed=7))
    return NativeCapture(folder)


def run(capture, tmp_path, program, about=ABOUT, limit_s=600.0, limit_bytes=0):
    (tmp_path / "mine.py").write_text("import os, sys\nimport numpy as np\n" + textwrap.dedent(program))
    command = f"{sys.executable} {tmp_path / 'mine.py'} {{capture}} {{depth}}"
    return foreign.image(command, capture, GRID, about, limit_s, limit_bytes)


def test_it_sees_the_first_frames_echoes_and_nothing_else(capture, tmp_path, monkeypatch):
    monkeypatch.setenv("A_SECRET", "1")
    seen = tmp_path / "seen.txt"
    program = f"""
        import h5py
        with h5py.File(sys.argv[1] + "/echoes.h5") as file:
            np.save({str(tmp_path / "samples.npy")!r}, file["samples"][:])
        text = open(sys.argv[1] + "/capture.toml").read()
        open({str(seen)!r}, "w").write(" ".join([*sorted(os.listdir(sys.argv[1])), *os.environ, text]))
    """ + textwrap.indent(WRITE, "    ")
    depth, seconds = run(capture, tmp_path, program)
    with h5py.File(capture.folder / "echoes.h5") as file:
        assert np.array_equal(np.load(tmp_path / "samples.npy"), file["samples"][:1])
    told = seen.read_text()
    assert told.startswith("capture.toml echoes.h5 ") and "A_SECRET" not in told and "PATH" in told
    assert "seed" not in told and "truth" not in told
    assert np.all(depth.z_m == np.float32(0.3)) and seconds > 0


def test_its_own_seconds_count_where_that_is_said(capture, tmp_path):
    own = ABOUT.model_copy(update={"timing": "depth map"})
    assert run(capture, tmp_path, WRITE, own)[1] == 1e-4
    with pytest.raises(HandbenchError, match="has seconds = 1000"):
        run(capture, tmp_path, WRITE.replace("seconds=1e-4", "seconds=1e3"), own)
    with pytest.raises(HandbenchError, match="lacks seconds"):
        run(capture, tmp_path, WRITE.replace(", seconds=1e-4", ""), own)


WRONG = {
    "its error": ('sys.exit("no such\\nantenna")', "hand: the command ended with exit code 1; it said last: antenna"),
    "nothing": ("pass", "wrote no {depth}"),
    "another grid": (WRITE.replace("0.02", "0.03"), "x_m is another grid"),
    "a pickle": ("np.savez(sys.argv[2], x_m=[{}], y_m=[0], z_m=[0], amplitude_db=[0])", "not a readable .npz"),
}


@pytest.mark.parametrize(("program", "words"), WRONG.values(), ids=WRONG)
def test_what_it_does_wrong_is_one_line(capture, tmp_path, program, words):
    with pytest.raises(HandbenchError, match=words.replace("{", "[{]")):
        run(capture, tmp_path, program)


def test_a_program_that_hangs_is_ended_with_all_that_it_started(capture, tmp_path, monkeypatch):
    child = tmp_path / "child.txt"
    guard_s = time.monotonic() + 600

    class TimedOutOnceItHasStarted(subprocess.Popen):
        def wait(self, timeout=None):
            while timeout is not None:
                assert time.monotonic() < guard_s
                if child.exists() and child.read_text():
                    raise subprocess.TimeoutExpired(self.args, timeout)
                time.sleep(0.05)
            return super().wait()

    monkeypatch.setattr(foreign.subprocess, "Popen", TimedOutOnceItHasStarted)
    program = f"""
        import subprocess, time
        child = subprocess.Popen(["sleep", "1000"])
        open({str(child)!r}, "w").write(str(child.pid))
        time.sleep(1000)
    """
    with pytest.raises(HandbenchError, match="took more than 3 s; raise --limit-s"):
        run(capture, tmp_path, program, limit_s=3.0)
    state = Path(f"/proc/{child.read_text()}/stat")
    with suppress(FileNotFoundError):  # gone, or dead and not yet waited for
        while state.read_text().split()[2] != "Z":
            assert time.monotonic() < guard_s
            time.sleep(0.05)


def test_memory_is_limited(capture, tmp_path):
    with pytest.raises(HandbenchError, match=r"said last: .*MemoryError"):
        run(capture, tmp_path, "np.zeros(2**31) + 1", limit_bytes=4 * 2**30)


@pytest.mark.parametrize(
    ("command", "words"), [("mine {capture}", "lacks {depth}"), ("mine '{capture} {depth}", "quote")]
)
def test_commands_that_cannot_work_are_refused_before(command, words):
    with pytest.raises(HandbenchError, match=words.replace("{", "[{]")):
        foreign.parts(command)
    with pytest.raises(HandbenchError, match="--command"):
        foreign.parts("")
