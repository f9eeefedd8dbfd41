"""Methods that handbench does not have: a command sees the echoes alone, in an environment without
our variables, its limits hold and it ends with us; depth maps are checked before they are
scored."""

import os
import shutil
import signal
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
from handbench.bench.results import load
from handbench.bench.run import foreign
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.reconstruct_stage import DEPTH, TIMING
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import load_depthmap
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json
from tests.small_benchmark import BENCH
from tests.test_docs import DOCS, blocks

GRID = PixelGrid(np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3))
WRITE = """
    x, y = np.linspace(-0.02, 0.02, 5), np.linspace(-0.01, 0.01, 3)
    z, a = np.full((3, 5), 0.3), np.zeros((3, 5))
    np.savez(sys.argv[2], x_m=x, y_m=y, z_m=z, amplitude_db=a, seconds=1e-9)
"""
GUARD_S = 600  # before a test gives up


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


def image(capture, tmp_path, program, limit_s=600.0, limit_mb=0):
    """What a program leaves as depth map and seconds."""
    (tmp_path / "mine.py").write_text(
        "import os, sys\nimport numpy as np\n" + textwrap.dedent(program)
    )
    command = foreign.words(f"{sys.executable} mine.py {{capture}} {{depth}}", tmp_path)
    made = tmp_path / "stage"
    made.mkdir(exist_ok=True)
    foreign.run(
        made, command, str(capture.folder), "mine", GRID.x_m, GRID.y_m, (limit_s, limit_mb), {}
    )
    return load_depthmap(made / DEPTH), read_json(made / TIMING, "times")["seconds"]


SLEEPS = """
    import subprocess, time
    child = subprocess.Popen(["sleep", "1000"])
    open({file!r}, "w").write(str(child.pid))
    time.sleep(1000)
"""


def test_it_sees_the_first_frames_echoes_and_nothing_else(capture, tmp_path, monkeypatch):
    monkeypatch.setenv("A_SECRET", "1")
    seen = tmp_path / "seen.txt"
    program = f"""
        import h5py
        with h5py.File(sys.argv[1] + "/echoes.h5") as file:
            np.save({str(tmp_path / "samples.npy")!r}, file["samples"][:])
        text = open(sys.argv[1] + "/capture.toml").read()
        known = *sorted(os.listdir(sys.argv[1])), *os.environ, text, os.getcwd()
        open({str(seen)!r}, "w").write(" ".join(known))
    """ + textwrap.indent(WRITE, "    ")
    depth, [seconds] = image(capture, tmp_path, program)
    with h5py.File(capture.folder / "echoes.h5") as file:
        assert np.array_equal(np.load(tmp_path / "samples.npy"), file["samples"][:1])
    written = seen.read_text()
    assert written.startswith("capture.toml echoes.h5 ") and "PATH" in written
    for secret in ("A_SECRET", "seed", "truth", str(capture.folder.parent)):
        assert secret not in written
    assert np.all(depth.z_m == np.float32(0.3)) and depth.method == "mine"
    assert seconds != 1e-9  # those of the whole command, not those that it claims


WRONG = {
    "its error": (
        'sys.exit("no such\\nantenna")',
        "ended with exit code 1; its last line: antenna",
    ),
    "killed": ("os.kill(os.getpid(), 9)", "ended with exit code 137"),
    "memory": ("np.zeros(2**31) + 1", r"its last line: .*MemoryError"),
    "nothing": ("pass", "did not write [{]depth}"),
}


@pytest.mark.parametrize(("program", "words"), WRONG.values(), ids=WRONG)
def test_what_it_does_wrong_is_one_line(capture, tmp_path, program, words):
    with pytest.raises(HandbenchError, match=words) as error:
        image(capture, tmp_path, program, limit_mb=4 * 2**10)
    assert "\n" not in str(error.value)


def wait_for_end(process):
    """Until a process has gone, or is dead and not yet waited for."""
    guard_s = time.monotonic() + GUARD_S
    with suppress(FileNotFoundError):
        while Path(f"/proc/{process}/stat").read_text().split()[2] != "Z":
            assert time.monotonic() < guard_s
            time.sleep(0.05)


def wait_for_text(file):
    guard_s = time.monotonic() + GUARD_S
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < guard_s
        time.sleep(0.05)
    return file.read_text()


def test_a_program_that_hangs_is_ended_with_all_that_it_started(capture, tmp_path, monkeypatch):
    child = tmp_path / "child.txt"

    class TimedOutOnceItHasStarted(subprocess.Popen):
        def wait(self, timeout=None):
            if timeout is not None:
                wait_for_text(child)
                raise subprocess.TimeoutExpired(self.args, timeout)
            return super().wait()

    monkeypatch.setattr(foreign.subprocess, "Popen", TimedOutOnceItHasStarted)
    with pytest.raises(HandbenchError, match="took more than 3 s and was stopped"):
        image(capture, tmp_path, SLEEPS.format(file=str(child)), limit_s=3.0)
    wait_for_end(child.read_text())


def test_it_ends_when_handbench_is_killed(tmp_path):
    child = tmp_path / "child.txt"
    (tmp_path / "mine.py").write_text(textwrap.dedent(SLEEPS).format(file=str(child)))
    runs = f"""
        from pathlib import Path
        from handbench.bench.run import foreign
        words = [{sys.executable!r}, {str(tmp_path / "mine.py")!r}]
        foreign._run(words, Path({str(tmp_path)!r}), 600.0, 0)
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(runs)]) as ours:
        process = wait_for_text(child)
        os.kill(ours.pid, signal.SIGKILL)
    wait_for_end(process)


MAPS = {
    "moved": ({"x_m": GRID.x_m + 1e-5}, "x_m differs from the benchmark's grid"),
    "a pickle": ({"x_m": [{}]}, "not a readable .npz"),
    "turned": ({"z_m": np.ones((5, 3))}, r"z_m is float64 \(5, 3\); expected real numbers"),
    "beyond float32": ({"z_m": np.full(GRID.shape, 1e300)}, "z_m is 1e.300 at"),
    "empty": ({"z_m": np.full(GRID.shape, np.nan)}, "no depth at all"),
    "NaN amplitudes": ({"amplitude_db": np.full(GRID.shape, np.nan)}, "amplitude_db is nan at"),
    "millimetres": ({"z_m": np.full(GRID.shape, 300.0)}, "check that the unit is metres"),
    "times": ({"seconds": np.ones(2)}, "seconds is array"),
}


@pytest.mark.parametrize(("changed", "words"), MAPS.values(), ids=MAPS)
def test_maps_that_cannot_be_scored_are_refused(tmp_path, changed, words):
    z_m, amplitude_db = np.full(GRID.shape, 0.3), np.zeros(GRID.shape)
    content = {"x_m": GRID.x_m, "y_m": GRID.y_m, "z_m": z_m, "amplitude_db": amplitude_db}
    np.savez(tmp_path / "a.npz", **content | changed)
    with pytest.raises(HandbenchError, match=words):
        foreign.read_map(tmp_path / "a.npz", "mine", GRID)


FLAT_M = 0.2825  # the foreign method's answer, whatever it sees
PROGRAM = f"""
import sys
import numpy as np
x = y = np.linspace(-0.02, 0.02, 21)
z = np.where(np.hypot(*np.meshgrid(x, y)) < 0.015, {FLAT_M}, np.nan)
a = -1e3 * np.hypot(*np.meshgrid(x, y))
np.savez(sys.argv[2], x_m=x, y_m=y, z_m=z, amplitude_db=a, seconds=0.25)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_result):
    """A benchmark of a captured ball, with a command and a folder of depth maps beside two methods
    of ours."""
    folder = tmp_path_factory.mktemp("foreign")
    shutil.copytree(next((small_result / "work").glob("simulate-*")) / "capture", folder / "ball")
    ball = 'path = "ball"\nmeasures = ["accuracy"]'
    text = BENCH.replace('scene = "ball.toml"', ball).replace("precision = true\n", "")
    (folder / "mine.py").write_text(PROGRAM)
    (folder / "maps").mkdir()
    command = [sys.executable, folder / "mine.py", "", folder / "maps" / "ball.npz"]
    subprocess.run(command, check=True)
    mine = f'[[method]]\nid = "mine"\ncommand = "{sys.executable} mine.py {{capture}} {{depth}}"\n'
    given = '[[method]]\nid = "given"\nmaps = "maps"\n'
    (folder / "bench.toml").write_text(text.replace("phase_noise_rad = 0.03\n", "") + mine + given)
    return folder


@pytest.mark.usefixtures("small_bench")  # whose times need not settle
def test_they_are_scored_beside_our_own_and_a_changed_program_runs_again(folder, capsys):
    bench, result = str(folder / "bench.toml"), folder / "result"
    assert main(["inspect", bench]) == 0
    assert main(["run", bench, "-o", str(result)]) == 0
    table = load(result).table.set_index(["method", "metric"]).value
    x_m = np.linspace(-0.02, 0.02, 21)
    beside_m = np.hypot(*np.meshgrid(x_m, x_m))
    near_m = 0.30 - np.sqrt(0.02**2 - np.minimum(beside_m, 0.015) ** 2)  # the ball: nothing of ours
    expected_mm = 1e3 * np.abs(FLAT_M - near_m)[beside_m < 0.015].mean()
    # the ball's mesh has 40 rings: flat by up to 0.03 mm
    assert table["mine", "mae_mm"] == pytest.approx(expected_mm, abs=0.03)
    assert table["given", "mae_mm"] == table["mine", "mae_mm"]
    assert table["given", "seconds"] == 0.25
    assert "mine" in set(load(result).equal.method)  # on common pixels
    (folder / "mine.py").write_text(PROGRAM.replace("0.015", "0.014"))
    assert main(["run", bench, "-o", str(result)]) == 0
    made = load(result).tasks.query("not cached and stage == 'reconstruct'")
    assert made.method.tolist() == ["mine"]
    capsys.readouterr()


GIVEN = 'maps = "maps"'
REFUSED = {
    "a submission": (
        GIVEN,
        'submission = "maps"',
        "the key submission is no longer used; give maps",
    ),
    "no folder": (GIVEN, 'maps = "mops"', "expected a folder with a depth map for each capture"),
    "no map": (GIVEN, 'maps = "ball"', "ball has no depth map for 1 of 1 captures: ball"),
    "our own": ('id = "given"', 'id = "3fsk"', "its id is that of a method of handbench"),
    "both": (GIVEN, f'{GIVEN}\ncommand = "a {{capture}} {{depth}}"', "maps and a command"),
    "a configuration": (GIVEN, f"{GIVEN}\nprecision = true", "is a method from outside handbench"),
    "no place": (GIVEN, 'command = "mine {capture}"', "the command has no {depth}"),
    "an open quote": (GIVEN, 'command = "m \'{capture} {depth}"', "quote it as for a shell"),
    "no file's name": ('id = "given"', 'id = "../given"', "cannot be the name of a file"),
}


@pytest.mark.parametrize(("old", "new", "words"), REFUSED.values(), ids=REFUSED)
def test_entries_that_cannot_work_are_refused_before_anything_runs(folder, capsys, old, new, words):
    file = folder / "refused.toml"
    file.write_text((folder / "bench.toml").read_text().replace(old, new))
    assert main(["inspect", str(file)]) == 2
    assert words in capsys.readouterr().out
    if "no depth map" not in words:  # which a run says of each capture
        with pytest.raises(HandbenchError) as error:
            load_benchmark(str(file))
        assert words in str(error.value)


def test_the_page_s_method_finds_the_ball(small_bench, tmp_path, capsys):
    """Its 2-FSK in NumPy, on fewer pixels, against the sphere itself: at the glint: 30 mm behind
    the plane imaged, where the path's slope, taken as 2, is up to 3 % smaller before this array."""
    code = blocks(DOCS / "own_data.md", "python")[-1]
    old, fewer = "np.arange(-150, 151)", "np.arange(-20, 21, 4)"
    assert old in code
    (tmp_path / "page.py").write_text(code.replace(old, fewer))
    ball = str(tmp_path / "ball")  # without noise
    assert main(["simulate", str(small_bench.parent / "ball.toml"), "-o", ball]) == 0
    capsys.readouterr()
    command = foreign.words(f"{sys.executable} page.py {{capture}} {{depth}}", tmp_path)
    x_m, made = np.arange(-20, 21, 4) * 1e-3, tmp_path / "stage"
    made.mkdir()
    foreign.run(made, command, ball, "page", x_m, x_m, (600.0, 0), {})
    assert load_depthmap(made / DEPTH).z_m[5, 5] == pytest.approx(0.28, abs=1e-3)
