"""Submissions: the depth maps of a method that handbench does not have, with what they took and what they were made of.

submission.toml  `Submission`: whose they are, of which benchmark
depths.csv       capture, file, sha256, seconds: a line for each capture of the benchmark
FILE             .npz with x_m [nx], y_m [ny], z_m [ny, nx], NaN off target, and amplitude_db [ny, nx], by which the
                 method trusts its pixels: 0 at the best
"""

import csv
import hashlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomlkit
from pydantic import Field

from handbench.bench.datasets.native import FAR_M
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.support.config import Config, Name, load, suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_bytes, read_npz, read_text, require_file, require_folder, write_text
from handbench.support.limits import ARRAY_BYTES, CSV_BYTES

DESCRIPTION, DEPTHS, MAPS = "submission.toml", "depths.csv", "maps"
COLUMNS = ("capture", "file", "sha256", "seconds")
SAME_M = 1e-6  # places on two grids that are the same
Input = Literal["echoes", "photographs", "mesh", "other sensors"]


class Submission(Config):
    """The content of submission.toml. inputs: all that the method looked at; timing: what `seconds` count, from echoes
    in memory to the depth map or the whole command; machine: facts, as `handbench doctor` tells them."""

    version: Literal[1] = 1
    method: Name
    benchmark: Name
    inputs: tuple[Input, ...] = Field(default=("echoes",), min_length=1)
    timing: Literal["depth map", "command"] = "depth map"
    command: str | None = None
    machine: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True)
class Row:
    """A line of depths.csv: a capture's depth map, the checksum of its file, and the seconds that it took."""

    capture: str
    file: str
    sha256: str
    seconds: float


def load_submission(folder: str | Path) -> tuple[Submission, dict[str, Row]]:
    """A submission's description, and its rows by capture. A HandbenchError names the first line that is wrong."""
    folder = require_folder(folder, f"a submission ({DESCRIPTION}, {DEPTHS})")
    about = load(Submission, folder / DESCRIPTION, "a submission's description")
    return about, _rows(folder / DEPTHS)


def _rows(file: Path) -> dict[str, Row]:
    try:
        text = read_text(file, "a line for each depth map", CSV_BYTES)
        first, *lines = list(csv.reader(text.splitlines(), strict=True)) or [[]]
    except (ValueError, csv.Error) as error:
        raise HandbenchError(f"{file}: is not readable as CSV ({error}); expected {', '.join(COLUMNS)}") from None
    if tuple(first) != COLUMNS:
        raise HandbenchError(f"{file}: has the columns {first}; expected {', '.join(COLUMNS)}")
    found: dict[str, Row] = {}
    for number, values in enumerate(lines, 2):
        where, line = f"{file}: line {number}", dict(zip(COLUMNS, values, strict=False))
        if len(values) != len(COLUMNS) or not line["capture"].isprintable():
            raise HandbenchError(f"{where}: expected {len(COLUMNS)} values, the first a capture's name")
        try:
            seconds = float(line["seconds"])
        except ValueError:
            seconds = np.nan
        if not 0 < seconds < np.inf:
            raise HandbenchError(f"{where}: seconds is '{line['seconds']}'; expected a number above 0")
        if line["capture"] in found:
            raise HandbenchError(f"{where}: has '{line['capture']}' again; expected each capture once")
        found[line["capture"]] = Row(line["capture"], line["file"], line["sha256"].lower(), seconds)
    return found


def save_submission(folder: Path, about: Submission, rows: dict[str, Row]) -> None:
    """Write both tables, atomically; the depth maps lie there already."""
    write_text(folder / DESCRIPTION, tomlkit.dumps(about.model_dump(exclude_none=True)))
    text = io.StringIO()
    lines = ((row.capture, row.file, row.sha256, f"{row.seconds:.6g}") for row in rows.values())
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *lines])
    write_text(folder / DEPTHS, text.getvalue())


def sha256(file: Path) -> str:
    """Checksum of a depth map's file."""
    return hashlib.sha256(read_bytes(file, "a depth map", ARRAY_BYTES)).hexdigest()


def problems(folder: Path, grids: dict[str, PixelGrid], benchmark: str) -> Iterator[str]:
    """All that keeps a submission from being scored; grids: that of each capture of the benchmark, by name."""
    about, rows = load_submission(folder)
    if about.benchmark != benchmark:
        yield f"{folder / DESCRIPTION}: is of the benchmark '{about.benchmark}'; expected '{benchmark}'"
        return
    for name in rows.keys() - grids.keys():
        yield f"{folder / DEPTHS}: '{name}' is no capture of '{benchmark}'; {suggest(name, list(grids))}"
    if missing := [name for name in grids if name not in rows]:
        few = ", ".join(missing[:5]) + (", …" if len(missing) > 5 else "")
        yield f"{folder / DEPTHS}: {len(missing)} of {len(grids)} captures are missing: {few}; every one counts"
    for name, grid in grids.items():
        try:
            if name in rows:
                depth_map(folder, rows[name], about.method, grid)
        except HandbenchError as error:
            yield str(error)


def depth_map(folder: Path, row: Row, method: str, grid: PixelGrid) -> DepthMap:
    """A row's depth map, float32, on its capture's grid. HandbenchError for a file that is not the one that was handed
    in, and for whatever cannot be scored."""
    file = require_file(inside(folder, row.file, f"{folder / DEPTHS}: file of '{row.capture}'"), "a depth map")
    if (found := sha256(file)) != row.sha256:
        raise HandbenchError(f"{file}: has the checksum {found[:12]}…, not {row.sha256[:12]}…: copy it again")
    return read_map(file, method, grid)


def read_map(file: Path, method: str, grid: PixelGrid) -> DepthMap:
    """A foreign method's depth map, held against the grid that was asked for."""
    content = read_npz(file, ("x_m", "y_m", "z_m", "amplitude_db"))
    for name, expected in (("x_m", grid.x_m), ("y_m", grid.y_m)):
        if content[name].shape != expected.shape or not _close(content[name], expected):
            given = f"{expected[0]:g} to {expected[-1]:g} m in {len(expected)} steps"
            raise HandbenchError(f"{file}: {name} is another grid than the benchmark's, {given}; image on that")
    for name in ("z_m", "amplitude_db"):
        if content[name].shape != grid.shape or content[name].dtype.kind != "f":
            found = f"{content[name].dtype} {content[name].shape}"
            raise HandbenchError(f"{file}: {name} is {found}; expected real numbers {grid.shape}")
    z_m, seen = content["z_m"].astype(np.float32), np.isfinite(content["z_m"])
    if np.isinf(content["z_m"]).any():
        raise HandbenchError(f"{file}: z_m has infinite depths; write NaN off target")
    if not seen.any():
        raise HandbenchError(f"{file}: z_m has no depth at all; a capture without any cannot be scored")
    if not np.isfinite(content["amplitude_db"][seen]).all():
        raise HandbenchError(f"{file}: amplitude_db is not finite where z_m has a depth; give every depth its own")
    if (far_m := np.abs(z_m[seen]).max()) > FAR_M:
        raise HandbenchError(f"{file}: z_m reaches {far_m:g} m; expected metres: are these millimetres?")
    return DepthMap(grid.x_m, grid.y_m, z_m, content["amplitude_db"].astype(np.float32), method)


def _close(found: np.ndarray, expected: np.ndarray) -> bool:
    return found.dtype.kind == "f" and bool(np.abs(found - expected).max() <= SAME_M)  # NaN is not close
