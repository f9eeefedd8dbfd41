"""Commands under full disks, lost folders, signals, short memory: what follows is the same result,
or one sentence, and the next run is as if nothing had been."""

from __future__ import annotations

import io
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
import traceback
from contextlib import contextmanager, redirect_stderr, redirect_stdout

import pytest
import tomlkit

from handbench.cli import doctor
from handbench.cli.main import main
from handbench.support.folder import MARKER
from tests.bench.datasets import test_mapping as foreign
from tests.bench.run.faults import DISK, content
from tests.faults.disk import files_of_at_most
from tests.faults.processes import ROOT, Runs
from tests.small_benchmark import write_bench

PIXELS = " ".join(f"--set {axis}.start_m=-0.01 --set {axis}.stop_m=0.01" for axis in "xy")
COMMANDS = {  # words after `handbench`: {i} is the folder of the inputs, {o} of the outputs
    "simulate": "simulate {i}/ball.toml -o {o}/out",
    "groundtruth": "groundtruth {i}/ball.ply --unit m -o {o}/out.ply",
    "reconstruct": f"reconstruct {{i}}/capture --method 2fsk {PIXELS} -o {{o}}/depth.npz",
    "import": "import mapping {i}/foreign -o {o}/out",
}


def once(words):
    """Run one command in this process: its exit code (None: an exception got out), and what it
    wrote to stderr."""
    errors = io.StringIO()
    with redirect_stderr(errors), redirect_stdout(io.StringIO()):
        try:
            code = main(shlex.split(words))
        except (Exception, SystemExit):
            traceback.print_exc(file=errors)
            code = None
    return code, errors.getvalue()


def one_sentence(code, errors):
    """Nothing worse than a user may meet."""
    assert code in (0, 2) and "Traceback" not in errors, errors
    assert code == 0 or errors.strip().splitlines()[-1].startswith("handbench: "), errors


class Gone:
    """Takes a folder away when Python code opens, or makes, the n-th thing below it."""

    folder, at = None, 0

    def __init__(self):
        sys.addaudithook(self.event)

    def event(self, event, arguments):
        if self.folder is None or event not in ("open", "os.mkdir"):
            return
        if str(arguments[0]).startswith(f"{self.folder}/"):
            self.at -= 1
            if self.at == 0:
                os.rename(self.folder, f"{self.folder}-gone")

    @contextmanager
    def gone(self, folder, at, back):
        self.folder, self.at, away = folder, at, folder.with_name(f"{folder.name}-gone")
        try:
            yield
        finally:
            self.folder = None
            if away.exists() and back:
                away.rename(folder)
            shutil.rmtree(away, ignore_errors=True)


GONE = Gone()
FAULTS = {
    "full at the first file": lambda i, o: DISK.full(o, 1),
    "full at the third file": lambda i, o: DISK.full(o, 3),
    "full at a rename": lambda i, o: DISK.full(o, 1, rename=True),
    "full in a file": lambda i, o: files_of_at_most(100),
    "outputs gone": lambda i, o: GONE.gone(o, 2, back=False),
    "inputs gone": lambda i, o: GONE.gone(i, 1, back=True),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """The inputs of all commands."""
    folder = write_bench(tmp_path_factory.mktemp("faults") / "inputs").parent
    (folder / "foreign").mkdir()
    foreign.matlab(folder / "foreign" / "hand.mat")
    (folder / "foreign" / foreign.MAPPING).write_text(tomlkit.dumps(foreign.mapping()))
    assert once(f"simulate {folder}/ball.toml -o {folder}/capture")[0] == 0
    return folder


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_ends_in_a_sentence_and_the_next_one_makes_the_same(
    inputs, tmp_path, command, fault
):
    whole, out = tmp_path / "whole", tmp_path / "out"
    whole.mkdir(), out.mkdir()
    assert once(COMMANDS[command].format(i=inputs, o=whole))[0] == 0
    words = COMMANDS[command].format(i=inputs, o=out)
    with FAULTS[fault](inputs, out):
        code, errors = once(words)
    one_sentence(code, errors)
    if code == 2:
        assert [path for path in out.rglob(".*") if path.name != MARKER] == []
        out.mkdir(exist_ok=True)
        code, errors = once(words)
        if "--overwrite" in errors:  # the fault came after it: what is there has to be whole
            code, errors = once(f"{words} --overwrite")
        assert code == 0, errors
        assert content(out) == content(whole)


@pytest.mark.parametrize(
    ("file", "old", "new"), [("ball.toml", b"seed = 3", b"seed = 4"), ("ball.ply", b"", b"")]
)
def test_an_edit_that_keeps_size_and_time_is_seen(tmp_path, file, old, new):
    """Of a mesh, one bit of a coordinate."""
    words = f"simulate {{}}/ball.toml -o {tmp_path}/out"
    inputs = write_bench(tmp_path / "inputs").parent
    assert once(words.format(inputs))[0] == 0
    path = inputs / file
    state, data = path.stat(), bytearray(path.read_bytes())
    if old:
        data = data.replace(old, new)
    else:
        data[data.index(b"end_header\n") + 11 + 8 * 3 * 40 + 5] ^= 1 << 3
    path.write_bytes(data)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    code, errors = once(words.format(inputs))
    assert code == 2 and "--overwrite" in errors
    assert once(f"{words.format(inputs)} --overwrite")[0] == 0
    again = content(tmp_path / "out")
    assert once(f"simulate {inputs}/ball.toml -o {tmp_path}/fresh")[0] == 0
    assert again == content(tmp_path / "fresh")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Runs of the small benchmark in processes, and what a whole one leaves."""
    folder = tmp_path_factory.mktemp("runs")
    found = Runs(write_bench(folder / "bench"), folder, photographs=False)
    assert found.run(folder / "whole")[0] == 0
    yield found, content(folder / "whole")
    found.end()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sent", "codes"), [(signal.SIGTERM, {-15}), (signal.SIGINT, {130, -2})], ids=["TERM", "INT"]
)
def test_a_run_that_a_signal_ends_after_a_stage_goes_on(runs, tmp_path, sent, codes):
    """SIGKILL after stages of several kinds is in tests/bench/run/test_resume.py."""
    processes, expected = runs
    number, out = processes.started(tmp_path / "out"), tmp_path / "out"
    while not list(out.glob("work/simulate-*")):
        time.sleep(0.005)
    os.kill(number, sent)
    code, errors = processes.ended()
    assert code in codes and "Traceback" not in errors
    assert processes.run(out)[0] == 0 and content(out) == expected


def command(*before, words):
    """A process that does something before it becomes a command."""
    code = "; ".join([*before, "from handbench.cli.main import main; sys.exit(main())"])
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}", *words.split()],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=300,
    )
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["read only", "missing", "file"])
def test_a_command_does_without_home_and_caches(inputs, tmp_path, monkeypatch, kind):
    (tmp_path / "read only").mkdir(mode=0o555)
    (tmp_path / "file").touch()
    # in a folder that can be made the kernels would be compiled
    cache = ("NUMBA_CACHE_DIR",) if kind == "file" else ()
    for name in ("HOME", "TMPDIR", "XDG_CACHE_HOME", "MPLCONFIGDIR", *cache):
        monkeypatch.setenv(name, str(tmp_path / kind))
    rights = "from tests.bench.run.faults import nobody_s_rights; nobody = nobody_s_rights()"
    words = COMMANDS["reconstruct"].format(i=inputs, o=tmp_path)
    one_sentence(*command(rights, "nobody.__enter__()", words=words))


@pytest.mark.slow
def test_of_two_runs_at_once_one_does_the_work(runs, tmp_path):
    processes, expected = runs
    code = (
        "import sys; from handbench.bench.run import reconstruct_stage as stage; "
        "from handbench.cli.main import main; stage.SETTLE_S = 0.0; sys.exit(main())"
    )
    words = [sys.executable, "-c", code, "run", str(processes.bench), "-o"]
    both = [
        subprocess.Popen([*words, str(tmp_path / "out")], stderr=-1, stdout=-3, text=True, cwd=ROOT)
        for _ in range(2)
    ]
    errors = [process.communicate(timeout=300)[1] for process in both]
    assert sorted(process.returncode for process in both) == [0, 2]
    assert sum("another run is writing into this folder" in text for text in errors) == 1
    assert content(tmp_path / "out") == expected


def test_a_full_disk_at_the_output_is_one_sentence():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "handbench", "list"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert done.returncode == 2
    one_sentence(done.returncode, done.stderr)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError("Unable to allocate 3.2 GiB"), "out of memory (Unable to allocate 3.2 GiB)"),
        (FileNotFoundError(2, "No such file or directory", "a.ply"), "a.ply: No such file or "),
        (OSError(27, "File too large"), "File too large"),
    ],
)
def test_what_the_system_refuses_is_one_sentence(monkeypatch, capsys, error, words):
    def refuse(_):
        raise error

    monkeypatch.setattr(doctor, "run", refuse)
    assert main(["doctor"]) == 2
    assert words in capsys.readouterr().err


def test_a_file_that_is_none_of_the_system_s_keeps_its_traceback(monkeypatch):
    def broken(_):
        raise FileNotFoundError("a bug")

    monkeypatch.setattr(doctor, "run", broken)
    with pytest.raises(FileNotFoundError, match="a bug"):
        main(["doctor"])
