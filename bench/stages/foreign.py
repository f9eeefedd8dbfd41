"""Methods that are not part of handbench: their depth maps are read from a folder, or made by a
program that gets the echoes.

The program gets only a folder with capture.toml and the echoes of one frame, and a few environment
variables. Its time is limited, and its process group ends with it. This protects against mistakes,
not against a malicious program.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, CaptureFile, save_echoes_folder
from handbench.bench.stages.image import configured
from handbench.bench.stages.reconstruct import DEPTH, SOURCES, TIMING, write_treated
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.settings import MethodSettings
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside, read_npz, real, write_json
from handbench.support.store import Input, Stage, stage

if TYPE_CHECKING:
    from handbench.bench.benchmarks.benchmark_file import BenchFile, MethodEntry

LIMIT_S = 600.0  # for one capture
SAME_M = 1e-6  # pixels of two grids that are the same
LAST_BYTES = 4096  # of a program's output, which an error quotes
# of the environment, which a program gets
VARIABLES = (
    "PATH",
    "HOME",
    "LANG",
    "USER",
    "TMPDIR",
    "LD_LIBRARY_PATH",
    "CUDA_VISIBLE_DEVICES",
    "OMP_NUM_THREADS",
)


def pixels(about: CaptureFile, methods: Sequence[MethodEntry]) -> PixelGrid:
    """Return the pixel grid on which a foreign method, not part of handbench, must give its depth
    map.
    This is the grid of the first method in the benchmark that is part of handbench; without such a
    method, the grid of the paper. about: description of the capture."""
    own = next((entry for entry in methods if not entry.foreign), None)
    config = MethodSettings() if own is None else configured(about, own.id, own.config)
    return config.pixels


def foreign_stage(
    bench: BenchFile, base: Path, capture: Input, about: CaptureFile, entry: MethodEntry
) -> Stage:
    """Return the stage that obtains the depth map of a foreign method, which is not part of
    handbench: it reads the file of the map, or runs the command of the method.
    base: folder to which the benchmark's paths are relative. capture: the capture's folder; about:
    its description. Raises HandbenchError if the file is missing."""
    grid = pixels(about, bench.method)
    arguments: dict[str, Any] = {"method": entry.label, "x_m": grid.x_m, "y_m": grid.y_m}
    if entry.command is not None:
        command = words(entry.command, base)
        files = [Path(word) for word in command if os.path.isfile(word)]
        arguments |= {
            "capture": capture,
            "command": Input(command, [entry.command, *map(content_hash, files)]),
            "limit_s": entry.limit_s or LIMIT_S,
            "config": {"command": entry.command},
        }
        return Stage(run, arguments, about.name, entry.label)
    folder = real(base, entry.maps or "", "method.maps")
    file = inside(folder, f"{about.name}.npz", "method.maps")
    if not file.is_file():
        there = suggest(file.name, [path.name for path in folder.glob("*") if path.is_file()])
        raise HandbenchError(f"{file}: expected a file, the depth map of '{about.name}'; {there}")
    arguments |= {
        "file": Input(str(file), content_hash(file)),
        "config": Input({"maps": entry.maps}, None),
    }
    return Stage(take, arguments, about.name, entry.label)


def words(command: str, base: Path) -> list[str]:
    """Split a command line into words. A word that names a file in the folder `base` becomes its
    path.
    base: folder of the benchmark file."""
    split = shlex.split(command)
    return [str(base / word) if os.path.isfile(base / word) else word for word in split]


@stage("reconstruct", "bench/stages/foreign.py", *SOURCES)
def take(
    folder: Path, file: str, method: str, x_m: np.ndarray, y_m: np.ndarray, config: Any
) -> None:
    """Check a depth map that another program made, and copy it to a stage's folder, together with
    the computing time if the file has one.
    file: the .npz file; method: id of the method; x_m [nx], y_m [ny]: the pixel centres that the
    map must have, metres; config: not used. Raises HandbenchError for a map that cannot be
    scored."""
    _save(folder, *read_map(Path(file), method, PixelGrid(x_m, y_m)))


@stage("reconstruct", "bench/stages/foreign.py", *SOURCES)
def run(
    folder: Path,
    command: list[str],
    capture: str,
    method: str,
    x_m: np.ndarray,
    y_m: np.ndarray,
    limit_s: float,
    config: Any,
) -> None:
    """Let a foreign program image the first frame of a capture, and write its depth map into a
    stage's folder.
    command: the words of the command line, with placeholders {capture} and {depth}. x_m [nx], y_m
    [ny]: the pixel centres that the map must have, metres. limit_s: longest duration, s. The
    recorded time is that of the whole command. config: not used. Raises HandbenchError if the
    program fails, takes too long, or writes no usable map."""
    data = open_capture(capture)
    with tempfile.TemporaryDirectory(
        prefix="handbench-foreign-", ignore_cleanup_errors=True
    ) as neutral:
        echoes, file = Path(neutral, "capture"), Path(neutral, "depth.npz")
        save_echoes_folder(echoes, data.echoes(1), {"name": data.about.name, "kind": "other"})
        filled = [
            word.replace("{capture}", str(echoes)).replace("{depth}", str(file)) for word in command
        ]
        seconds = _run(filled, neutral, limit_s)
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
    write_treated(folder, lambda settings: depth, MethodSettings(), depth)
    depth.save(folder / DEPTH)
    write_json(folder / TIMING, {"seconds": seconds})


def _run(command: list[str], folder: str, limit_s: float) -> float:
    """Run a command in a folder and return its duration, s. All processes of its process group are
    killed at its end, and when this process ends.
    Raises HandbenchError if the command does not start, takes longer than limit_s, or ends with an
    error."""
    with tempfile.TemporaryFile() as output:
        start = time.perf_counter()
        try:
            child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                cwd=folder,
                env={name: value for name, value in os.environ.items() if name in VARIABLES},
                start_new_session=True,
            )
        except OSError as error:
            raise HandbenchError(
                f"command: '{command[0]}' does not start ({error.strerror}); give its path, or "
                "install it"
            ) from None
        try:
            with _killed(child.pid):
                code = child.wait(limit_s)
                seconds = time.perf_counter() - start
        except subprocess.TimeoutExpired:
            raise HandbenchError(
                f"the command took more than {limit_s:g} s and was stopped; make it faster, or "
                "raise limit_s"
            ) from None
        finally:
            child.wait()
        if code != 0:
            end = f"with exit code {code}" if code > 0 else f"by signal {-code}"
            raise HandbenchError(
                f"the command was ended {end}; correct it; its last line: {_last_line(output)}"
            )
    return seconds


@contextmanager
def _killed(group: int) -> Iterator[None]:
    """Context manager that kills a process group when its block ends, or this process does.
    A shell waits for the end of the pipe that this process holds, and kills the group then."""
    words = ["sh", "-c", 'read _; kill -KILL "-$1"', "sh", str(group)]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    ):
        yield


def _last_line(output: BinaryIO) -> str:
    """Return the last line of a file."""
    output.seek(max(output.seek(0, os.SEEK_END) - LAST_BYTES, 0))
    lines = output.read().decode("utf-8", "replace").strip().splitlines() or ["none"]
    return lines[-1][:300]


def read_map(file: Path, method: str, grid: PixelGrid) -> tuple[DepthMap, list[float]]:
    """Read the depth map of a foreign method from an .npz file; return it with its computing times,
    s ([] if the file has none).
    grid: the pixels that the map must have. Depths and amplitudes become float32. Raises
    HandbenchError for a map that cannot be scored, as one on another grid or without any depth."""
    content: dict[str, Any] = read_npz(
        file, ("x_m", "y_m", "z_m", "amplitude_db"), optional=("seconds",)
    )
    seconds = content.pop("seconds", np.zeros(0))
    depth = DepthMap(**content, method=method).checked(file)
    for name, expected in (("x_m", grid.x_m), ("y_m", grid.y_m)):
        given = content[name]
        if given.shape != expected.shape or np.abs(given - expected).max() > SAME_M:
            axis = f"{expected[0]:g} to {expected[-1]:g} m in {len(expected)} steps"
            raise HandbenchError(
                f"{file}: {name} differs from the benchmark's grid, {axis}; compute the depth "
                "map on this grid"
            )
    far_m = np.abs(depth.z_m[np.isfinite(depth.z_m)]).max(initial=0)
    if not 0 < far_m <= FAR_M:
        found = f"depths up to {far_m:g}" if far_m else "no depth, only NaN or 0"
        raise HandbenchError(
            f"{file}: z_m has {found}; expected metres, at most {FAR_M:g}, for at least one pixel, "
            "and NaN for pixels without a depth"
        )
    positive = seconds.dtype.kind in "fiu" and ((seconds > 0) & (seconds < np.inf)).all()
    if seconds.size > 1 or not positive:
        raise HandbenchError(
            f"{file}: seconds is {str(seconds)[:60]}; expected one number above 0, or none at all"
        )
    single = {name: content[name].astype(np.float32) for name in ("z_m", "amplitude_db")}
    return DepthMap(grid.x_m, grid.y_m, **single, method=method), seconds.ravel().tolist()
