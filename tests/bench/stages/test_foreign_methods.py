"""Methods that handbench does not have: a command sees the echoes only, its time limit holds, and
its depth maps are checked before they are scored."""

import subprocess
import sys
import textwrap
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import psutil
import pytest

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.native import CaptureFile, NativeCapture, save_capture_file
from handbench.bench.stages import foreign
from handbench.bench.stages.reconstruct import DEPTH
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import PixelGrid
from handbench.support.store import Input
from tests.bench.run.faults import execute
from tests.refusals import refuse

GRID = PixelGrid(np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3))


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


def image(capture, tmp_path, program, limit_s=600.0):
    """The depth map that a program leaves."""
    (tmp_path / "mine.py").write_text(
        "import os, subprocess, sys, time\n" + textwrap.dedent(program)
    )
    command = foreign.words(f"{sys.executable} mine.py {{capture}} {{depth}}", tmp_path)
    made = tmp_path / "stage"
    made.mkdir()
    foreign.run(made, command, str(capture.folder), "mine", GRID.x_m, GRID.y_m, limit_s, {})
    return load_depthmap(made / DEPTH)


def ends(process: int) -> bool:
    """Whether a process ends within five seconds."""
    for _ in range(100):
        with suppress(psutil.NoSuchProcess):
            if psutil.Process(process).status() != psutil.STATUS_ZOMBIE:
                time.sleep(0.05)
                continue
        return True
    return False


def test_it_sees_the_first_frames_echoes_and_nothing_else(capture, tmp_path, monkeypatch):
    monkeypatch.setenv("A_SECRET", "1")
    seen = tmp_path / "seen.txt"
    program = f"""
        import h5py
        import numpy as np
        with h5py.File(sys.argv[1] + "/echoes.h5") as file:
            np.save({str(tmp_path / "samples.npy")!r}, file["samples"][:])
        text = open(sys.argv[1] + "/capture.toml").read()
        known = *sorted(os.listdir(sys.argv[1])), *os.environ, text, os.getcwd()
        open({str(seen)!r}, "w").write(" ".join(known))
        x, y = np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3)
        z, a = np.full((3, 5), 0.3), np.zeros((3, 5))
        np.savez(sys.argv[2], x_m=x, y_m=y, z_m=z, amplitude_db=a)
    """
    depth = image(capture, tmp_path, program)
    with h5py.File(capture.folder / "echoes.h5") as file:
        assert np.array_equal(np.load(tmp_path / "samples.npy"), file["samples"][:1])
    written = seen.read_text()
    assert written.startswith("capture.toml echoes.h5 ") and "PATH" in written
    for secret in ("A_SECRET", "seed", "truth", str(capture.folder.parent)):
        assert secret not in written
    assert np.all(depth.z_m == np.float32(0.3)) and depth.method == "mine"


@pytest.mark.parametrize(
    ("program", "place"),
    [
        ("print('x' * 10**6)\nprint('many')\nsys.exit('no \x1b antenna')", r"no \x1b antenna"),
        ("pass", "{depth}"),
        ("os.kill(os.getpid(), 9)", "signal 9"),
    ],
)
def test_a_program_that_fails_is_one_line_with_its_last_one(capture, tmp_path, program, place):
    refuse(lambda: image(capture, tmp_path, program), place)


def test_a_program_that_is_not_there_is_named(tmp_path):
    refuse(lambda: foreign._run(["nonesuch"], str(tmp_path), 1.0), "'nonesuch'")


HANG = """
child = subprocess.Popen(["sleep", "1000"])
with open({file!r}, "w") as file:
    print(os.getpid(), child.pid, flush=True, file=file)
time.sleep(1000)
"""


def test_a_program_that_hangs_ends_at_the_limit_with_its_children(capture, tmp_path):
    hang = HANG.format(file=str(tmp_path / "ids"))
    refuse(lambda: image(capture, tmp_path, hang, limit_s=2.0), "limit_s")
    assert all(ends(int(process)) for process in (tmp_path / "ids").read_text().split())


def test_a_killed_handbench_leaves_no_program(tmp_path):
    (tmp_path / "mine.py").write_text("import os, subprocess, time\n" + HANG.format(file="ids"))
    command = [sys.executable, str(tmp_path / "mine.py")]
    call = f"_run({command}, {str(tmp_path)!r}, 60)"
    code = f"from handbench.bench.stages.foreign import _run; {call}"
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path) as handbench:
        while not (file := tmp_path / "ids").exists() or not file.read_text().endswith("\n"):
            assert handbench.poll() is None
            time.sleep(0.05)
        handbench.kill()
    program, child = (int(process) for process in file.read_text().split())
    psutil.Process(child).kill()
    assert ends(program)


@pytest.mark.parametrize(
    "changed",
    [
        {"x_m": GRID.x_m + 1e-5},
        {"z_m": np.ones((5, 3))},
        {"z_m": np.full(GRID.shape, np.nan)},
        {"z_m": np.full(GRID.shape, 300.0)},
        {"seconds": np.array("soon")},
    ],
    ids=["moved", "turned", "empty", "millimetres", "seconds"],
)
def test_maps_that_cannot_be_scored_are_refused(tmp_path, changed):
    z_m, amplitude_db = np.full(GRID.shape, 0.3), np.zeros(GRID.shape)
    content = {"x_m": GRID.x_m, "y_m": GRID.y_m, "z_m": z_m, "amplitude_db": amplitude_db}
    np.savez(tmp_path / "a.npz", **content | changed)
    refuse(lambda: foreign.read_map(tmp_path / "a.npz", "mine", GRID), "a.npz", *changed)


FLAT_M = 0.2825  # the foreign method's answer, whatever it sees
PROGRAM = f"""
import sys
import numpy as np
x = y = np.linspace(-0.02, 0.02, 21)
z = np.where(np.hypot(*np.meshgrid(x, y)) < 0.015, {FLAT_M}, np.nan)
np.savez(sys.argv[2], x_m=x, y_m=y, z_m=z, amplitude_db=np.zeros(z.shape), seconds=0.25)
"""


@pytest.fixture
def bench(recorded, small_bench) -> Path:
    """A benchmark of a captured ball, with a command and a folder of depth maps beside a method of
    ours, whose times need not settle."""
    folder = small_bench.parent
    (folder / "mine.py").write_text(PROGRAM)
    (folder / "maps").mkdir()
    command = [sys.executable, folder / "mine.py", "", folder / "maps" / "ball.npz"]
    subprocess.run(command, check=True)
    text = small_bench.read_text().rpartition("[[method]]")[0].replace("precision = true\n", "")
    text += f'[[method]]\nid = "mine"\ncommand = "{sys.executable} mine.py {{capture}} {{depth}}"\n'
    text = text.replace('path = "ball"', 'path = "ball"\nmeasures = ["accuracy"]')
    small_bench.write_text(text + '[[method]]\nid = "given"\nmaps = "maps"\n')
    return small_bench


def test_they_are_scored_beside_our_own(bench, undoubted, tmp_path):
    table = execute(bench, tmp_path / "out").table.set_index(["method", "metric"]).value
    x_m = np.linspace(-0.02, 0.02, 21)
    beside_m = np.hypot(*np.meshgrid(x_m, x_m))
    near_m = 0.30 - np.sqrt(0.02**2 - np.minimum(beside_m, 0.015) ** 2)
    expected_mm = 1e3 * np.abs(FLAT_M - near_m)[beside_m < 0.015].mean()
    # the ball's mesh has 40 rings: flat by up to 0.03 mm
    assert table["mine", "mae_mm"] == pytest.approx(expected_mm, abs=0.03)
    assert table["given", "mae_mm"] == table["mine", "mae_mm"]
    assert table["given", "seconds"] == 0.25


def test_a_link_out_of_the_folder_of_maps_is_refused(bench):
    maps = bench.parent / "maps"
    (maps / "ball.npz").rename(bench.parent / "elsewhere.npz")
    (maps / "ball.npz").symlink_to(bench.parent / "elsewhere.npz")
    opened, base = load_benchmark(str(bench))
    entry = opened.method[-1]
    folder = Input(str(base / "ball"), "")
    about = CaptureFile(name="ball")
    refuse(lambda: foreign.foreign_stage(opened, base, folder, about, entry), "ball.npz")
