"""Methods that are not part of handbench: their depth maps are read from a folder, or made by a
program that gets the echoes.

The program gets only a folder with capture.toml and the echoes of one frame, and a few environment
variables. Its time, memory and output are limited. All processes that it started end when it ends,
and when handbench ends (`supervisor.py`). This protects against mistakes, not against a malicious
program.
"""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, CaptureFile, save_echoes_folder
from handbench.bench.pipeline.image import configured
from handbench.bench.run import supervisor
from handbench.bench.run.benchmark_file import MethodEntry
from handbench.bench.run.reconstruct_stage import DEPTH, TIMING, write_treated
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid, VoxelGrid
from handbench.radar.methods.fsk_config import PixelsConfig
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, read_npz, write_json
from handbench.support.progress import say

LIMIT_S, LIMIT_MB = 600.0, 16384  # for one capture; megabytes of addresses
SAME_M = 1e-6  # pixels of two grids that are the same
VARIABLES = (
    *("PATH", "HOME", "LANG", "USER", "TMPDIR", "LD_LIBRARY_PATH"),
    *("CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS"),
)


def pixels(about: CaptureFile, methods: Sequence[MethodEntry]) -> PixelGrid:
    """Return the pixel grid on which a foreign method, not part of handbench, must give its depth
    map.
    This is the grid of the first method in the benchmark that is part of handbench; without such a
    method, the grid of the paper. about: description of the capture."""
    own = next((entry for entry in methods if not entry.foreign), None)
    config = PixelsConfig() if own is None else configured(about, own.id, own.config)
    grid = config.grid() if hasattr(config, "grid") else PixelsConfig().grid()
    return grid.pixels if isinstance(grid, VoxelGrid) else grid


def words(command: str, base: Path) -> list[str]:
    """Split a command line into words. A word that names a file in the folder `base` becomes its
    path.
    base: folder of the benchmark file."""
    split = shlex.split(command)
    return [str(base / word) if os.path.isfile(base / word) else word for word in split]


def program_key(command: str, base: Path) -> list[str]:
    """Return the values that identify a foreign program: its command line, and the hash of each
    file that the command line names.
    base: folder of the benchmark file, where these files are looked for."""
    return [
        command,
        *(content_hash(Path(word)) for word in words(command, base) if os.path.isfile(word)),
    ]


def take(
    folder: Path, file: str, method: str, x_m: np.ndarray, y_m: np.ndarray, config: Any
) -> None:
    """Check a depth map that another program made, and copy it to a stage's folder, together with
    the computing time if the file has one.
    file: the .npz file; method: id of the method; x_m [nx], y_m [ny]: the pixel centres that the
    map must have, metres; config: not used. Raises HandbenchError for a map that cannot be
    scored."""
    depth, seconds = read_map(Path(file), method, PixelGrid(x_m, y_m))
    _save(folder, depth, [] if seconds is None else [seconds])


def run(
    folder: Path,
    command: list[str],
    capture: str,
    method: str,
    x_m: np.ndarray,
    y_m: np.ndarray,
    limits: tuple[float, int],
    config: Any,
) -> None:
    """Let a foreign program image the first frame of a capture, and write its depth map into a
    stage's folder.
    command: the words of the command line, with placeholders {capture} and {depth}. x_m [nx], y_m
    [ny]: the pixel centres that the map must have, metres. limits: seconds, and megabytes of
    address space (0: no limit). The recorded time is that of the whole command. config: not used.
    Raises HandbenchError if the program fails, takes too long, or writes no usable map."""
    data = open_capture(capture)
    with ExitStack() as ending:
        room = Path(tempfile.mkdtemp(prefix="handbench-foreign-"))
        ending.callback(_delete, room)
        echoes, file = room / "capture", room / "depth.npz"
        save_echoes_folder(echoes, data.echoes(1), {"name": data.about.name, "kind": "other"})
        places = {"{capture}": str(echoes), "{depth}": str(file)}
        for name, place in places.items():
            command = [word.replace(name, place) for word in command]
        say(f"{data.about.name}: running {shlex.join(command)}")
        seconds = _run(command, room, *limits)
        if not file.is_file():
            raise HandbenchError(
                "the command ended without an error but did not write {depth}; let it write an "
                ".npz file there"
            )
        depth, _ = read_map(file, method, PixelGrid(x_m, y_m))
    _save(folder, depth, [seconds])


def _save(folder: Path, depth: DepthMap, seconds: list[float]) -> None:
    """Write the depth map of a foreign method and its computing times into a stage's folder, in the
    files that handbench's own methods write.
    The maps under equal treatment (same smoothing for all methods) are made by smoothing `depth`;
    smoothing by the foreign method itself cannot be undone. seconds: may be empty."""
    write_treated(folder, lambda settings: depth, PixelsConfig(), depth)
    depth.save(folder / DEPTH)
    write_json(folder / TIMING, {"seconds": seconds})


def _run(command: list[str], room: Path, limit_s: float, limit_mb: int) -> float:
    """Run a command in the folder `room`, under a supervising process, and return its duration, s.
    limit_s: longest duration, s; limit_mb: address space, megabytes (0: no limit). Raises
    HandbenchError if the command is not found, takes too long, or ends with an error."""
    environment = {name: value for name, value in os.environ.items() if name in VARIABLES}
    if shutil.which(command[0], path=environment.get("PATH")) is None:
        raise HandbenchError(
            f"command: '{command[0]}' is not a program on this machine; give its path, or install "
            "it"
        )
    above = str(os.getpid()), str(room), str(limit_mb * 2**20)
    start = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-IS", supervisor.__file__, *above, *command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=room,
        env=environment,
        start_new_session=True,
    ) as child:
        try:
            code = child.wait(limit_s)  # its output is shorter than a pipe holds
        except subprocess.TimeoutExpired:
            raise HandbenchError(
                f"the command took more than {limit_s:g} s and was stopped; make it faster, or "
                "raise limit_s"
            ) from None
        finally:
            _end(child)
        seconds = time.perf_counter() - start
        if code != 0:
            last = _last_line(child.stdout.read() if child.stdout else b"")
            raise HandbenchError(f"the command ended with exit code {code}; its last line: {last}")
    return seconds


def _end(child: subprocess.Popen[bytes]) -> None:
    """End the supervising process, which then kills the foreign program and everything that this
    started."""
    if child.poll() is None:
        child.terminate()
        child.send_signal(signal.SIGCONT)  # the program may have stopped it
        late = threading.Timer(2 * supervisor.END_S, child.kill)
        late.start()
        child.wait()
        late.cancel()


def _last_line(output: bytes) -> str:
    lines = output.decode("utf-8", "replace").strip().splitlines()
    text = lines[-1][:300] if lines else "none"
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _delete(folder: Path) -> None:
    """Delete the folder in which a foreign program ran.
    If the program left something that cannot be deleted, such as immutable files or thousands of
    nested folders, a message asks the user to delete it."""
    with suppress(OSError, RecursionError):
        if folder.exists():  # else the supervising process has deleted it
            shutil.rmtree(folder)
        return
    say(f"{folder}: could not be deleted completely; delete it by hand")


def read_map(file: Path, method: str, grid: PixelGrid) -> tuple[DepthMap, float | None]:
    """Read the depth map of a foreign method from an .npz file; return it with its computing time,
    s (None if the file has none).
    grid: the pixels that the map must have. Depths and amplitudes become float32. Raises
    HandbenchError for a map that cannot be scored, as one on another grid or without any depth."""
    content: dict[str, Any] = read_npz(
        file, ("x_m", "y_m", "z_m", "amplitude_db"), optional=("seconds",)
    )
    seconds = content.pop("seconds", None)
    given = DepthMap(**content, method=method).checked(file)
    for name, expected in (("x_m", grid.x_m), ("y_m", grid.y_m)):
        found = content[name]
        if found.shape != expected.shape or not np.allclose(found, expected, rtol=0, atol=SAME_M):
            axis = f"{expected[0]:g} to {expected[-1]:g} m in {len(expected)} steps"
            raise HandbenchError(
                f"{file}: {name} differs from the benchmark's grid, {axis}; compute the depth "
                "map on this grid"
            )
    with np.errstate(over="ignore"):  # too large a number becomes infinite, which is refused below
        z_m, amplitude_db = (m.astype(np.float32) for m in (given.z_m, given.amplitude_db))
    seen = np.isfinite(z_m)
    if not seen.any():
        raise HandbenchError(
            f"{file}: z_m has no depth at all, so it cannot be scored; write a depth for at least "
            "one pixel"
        )
    if (far_m := np.abs(z_m[seen]).max()) > FAR_M:
        raise HandbenchError(
            f"{file}: z_m has a depth of {far_m:g} m; check that the unit is metres"
        )
    depth = DepthMap(grid.x_m, grid.y_m, z_m, amplitude_db, method).checked(file)
    if seconds is None:
        return depth, None
    if seconds.shape != () or seconds.dtype.kind not in "fiu" or not 0 < seconds < np.inf:
        raise HandbenchError(
            f"{file}: seconds is {seconds!r:.60}; expected one number above 0, or none at all"
        )
    return depth, float(seconds)
