"""A foreign method: a command in an environment of its own, which gets a capture's echoes and leaves a depth map.

It sees a folder with capture.toml and echoes.h5 and nothing else of the capture, few of our environment's variables,
and limits to its time and memory. That keeps honest methods apart; it is no wall against a program that means harm.
"""

import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from handbench.bench.datasets.native import ECHOES, CaptureFile, NativeCapture, save_capture_file
from handbench.bench.submissions.submission import Submission, read_map
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError
from handbench.support.files import read_npz

PLACES = ("{capture}", "{depth}")  # in a command: the folder to read, the file to write
KEPT = ("PATH", "HOME", "LANG", "USER", "TMPDIR", "LD_LIBRARY_PATH", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS")
TOLD_BYTES = 4096  # of what it said last
# Limits are set by the child itself, before it becomes the command: between threads nothing else is safe.
LIMITED = "import os, resource, sys; n = int(sys.argv[1]); resource.setrlimit(resource.RLIMIT_AS, (n, n)); " + (
    "os.execvp(sys.argv[2], sys.argv[2:])"
)


def parts(command: str) -> list[str]:
    """A command line's words; HandbenchError where it names no capture or no depth map."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise HandbenchError(f"--command: is not readable ({error}); quote it as for a shell") from None
    if missing := [place for place in PLACES if not any(place in word for word in words)]:
        raise HandbenchError(
            f"--command: lacks {' and '.join(missing)}; expected as in 'python mine.py {' '.join(PLACES)}'"
        )
    return words


def image(
    command: str, capture: NativeCapture, grid: PixelGrid, about: Submission, limit_s: float, limit_bytes: int
) -> tuple[DepthMap, float]:
    """The depth map that a command makes of a capture's first frame, and its seconds: those of the whole command, or
    where about.timing says so those that it writes into the file. What it does wrong is a HandbenchError."""
    with tempfile.TemporaryDirectory(prefix="handbench-foreign-") as temporary:
        folder, file = Path(temporary, "capture"), Path(temporary, "depth.npz")
        _hand_out(capture, folder)
        words = [word.replace("{capture}", str(folder)).replace("{depth}", str(file)) for word in parts(command)]
        seconds = _run(words, limit_s, limit_bytes, Path(temporary, "said"), name := capture.about.name)
        if not file.is_file():
            raise HandbenchError(f"{name}: the command ended well but wrote no {{depth}}; expected an .npz there")
        depth = read_map(file, about.method, grid)
        if about.timing == "depth map":
            own = read_npz(file, ("seconds",))["seconds"]
            if own.shape != () or own.dtype.kind not in "fiu" or not 0 < own <= seconds:
                raise HandbenchError(f"{name}: {{depth}} has seconds = {own}; expected one, {seconds:.3g} at most")
            seconds = float(own)
    return depth, seconds


def _hand_out(capture: NativeCapture, folder: Path) -> None:
    """Write what a method may see of a capture: the first frame's echoes, and its name."""
    folder.mkdir()
    save_capture(folder / ECHOES, capture.echoes(1))
    save_capture_file(folder, CaptureFile(name=capture.about.name, kind="other", contains=(ECHOES,)))


def _run(words: list[str], limit_s: float, limit_bytes: int, said: Path, name: str) -> float:
    """Seconds that a command took."""
    environment = {name: value for name, value in os.environ.items() if name in KEPT}
    limited = [sys.executable, "-c", LIMITED, str(limit_bytes), *words] if limit_bytes else words
    start = time.perf_counter()
    with said.open("wb") as stream:
        try:
            child = subprocess.Popen(
                limited,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )
        except OSError as error:
            raise HandbenchError(f"--command: {words[0]} cannot be started ({error.strerror})") from None
        try:
            code = child.wait(limit_s)
        except subprocess.TimeoutExpired:
            raise HandbenchError(f"{name}: the command took more than {limit_s:g} s; raise --limit-s") from None
        finally:
            with suppress(ProcessLookupError):  # what it left running ends too
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    seconds = time.perf_counter() - start
    if code != 0:
        last = said.read_bytes()[-TOLD_BYTES:].decode("utf-8", "replace").strip().splitlines()[-1:] or ["nothing"]
        raise HandbenchError(f"{name}: the command ended with exit code {code}; it said last: {last[0][:300]}")
    return seconds
