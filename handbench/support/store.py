"""The store of finished stages on disk. Each is in a folder named by its key, the hash of
everything that its result depends on.

The key is made of the stage's parameters, of the content of its inputs (or the keys of the stages
that made them), and of all code that it runs, down to the versions of libraries
(`support.code_hash`). The code is found automatically. A changed input, option, source file or
library therefore never gives an outdated result.

A folder appears complete or not at all, so that an interrupted run resumes where it stopped. It
contains checksums of its files, by which damage is found before the files are used, and a stamp
with the cost of making it.
"""

import json
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import InitVar, asdict, dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from handbench.support import code_hash
from handbench.support.cost import Cost, calibrated_machine, measured
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, read_json, write_json
from handbench.support.folder import is_owned_folder, read_owned, require_owned
from handbench.support.progress import say

# in each folder: size and checksum of its files; what they cost
MANIFEST, STAMP = ("manifest.json", "stage.json")
LIBRARIES = (
    "handbench",
    "numpy",
    "scipy",
    "numba",
    "open3d",
    "pycolmap",
    "opencv-contrib-python-headless",
    "h5py",
)


@dataclass(frozen=True)
class Stage:
    """A processing step whose result is stored on disk: a call of `function` with a folder to fill
    and `arguments` (plain values and paths). Any machine that sees these files can run it. The
    function is one at the top level of a module.

    name, capture, method: what the step does, for which capture and which method (the last two may
    be empty). inputs: everything besides code on which the result depends: values, paths of files,
    keys of earlier steps. plugged: values that identify code which cannot be found by following
    imports, such as a plug-in. code: hash of all code that runs. key: hash of everything on which
    the result depends.
    """

    name: str
    function: Callable[..., Any]
    arguments: dict[str, Any]
    inputs: InitVar[list[Any]]
    capture: str = ""
    method: str = ""
    plugged: InitVar[tuple[str, ...]] = ()
    code: str = field(init=False)
    key: str = field(init=False)

    def __post_init__(self, inputs: list[Any], plugged: tuple[str, ...]) -> None:
        code = stage_code_hash(self.function, plugged)
        object.__setattr__(self, "code", code)
        object.__setattr__(
            self, "key", content_hash(self.name, self.capture, self.method, *inputs, code)
        )

    @property
    def label(self) -> str:
        """Name, capture and method, joined by "-". It is printed, and the name of the step's folder
        begins with it."""
        return "-".join(part for part in (self.name, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """Return the path of the folder with the result of this step, in the store `root`."""
        return root / f"{self.label}-{self.key[:16]}"


@dataclass
class Stamp(Cost):
    """The cost of making a stored result, and facts of the machine that made it."""

    machine: dict[str, Any] = field(default_factory=dict)


def stage_code_hash(function: Callable[..., Any], plugged: tuple[str, ...] = ()) -> str:
    """Return the hash of all code that a function runs: its module and everything that this
    imports, as this process first read it.
    plugged: values that identify code which cannot be found by following imports, such as a
    plug-in."""
    return content_hash(code_hash.key_of(function.__module__), plugged)


def cached(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """Run a processing step, unless the store `root` has its complete result.
    Returns the cost of making the result, and whether it was in the store already. A result whose
    checksums do not match is reported and computed again."""
    require_owned(root)
    folder = stage.folder(root)
    if is_owned_folder(folder):
        if (wrong := changed(folder)) is None:
            return Stamp(**read_json(folder / STAMP, "a stage's stamp")), True
        say(f"{folder}: {wrong}, so this step is computed again")
    machine = calibrated_machine()  # once, before anything is timed
    with atomic_folder(folder) as temporary:
        with measured() as cost:
            stage.function(temporary, **stage.arguments)
        stamp = Stamp(**asdict(cost), machine=machine)
        write_json(temporary / STAMP, asdict(stamp))
        write_json(temporary / MANIFEST, _checksums(temporary))
    return stamp, False


def changed(folder: Path) -> str | None:
    """Describe what is wrong with a stored result: files that differ from their checksums, or a
    list of checksums that is missing or broken. Returns None if nothing is wrong."""
    try:
        written = json.loads(b"".join(read_owned(folder / MANIFEST)))
        expected = {name: tuple(facts) for name, facts in written.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, HandbenchError):
        expected = {}
    if STAMP not in expected:  # which every list that is ours names
        return f"the file {MANIFEST} is missing or damaged"
    found = _checksums(folder)
    wrong = sorted(name for name in expected if expected[name] != found.get(name))
    if not wrong:
        return None
    return (
        f"{wrong[0]}{f' and {len(wrong) - 1} more' if len(wrong) > 1 else ''} changed since it "
        "was written (its checksum differs)"
    )


def _checksums(folder: Path) -> dict[str, tuple[int, int]]:
    """Compute size and CRC-32 of every file in a folder except the manifest: relative path →
    (bytes, CRC). A CRC detects accidental changes and takes 0.4 s per GB."""
    found = {}
    for file in sorted(f"{at}/{name}" for at, _, names in os.walk(folder) for name in names):
        if file == f"{folder}/{MANIFEST}":
            continue
        with suppress(HandbenchError):  # what is no file of ours is none of those that were made
            size, crc = 0, 0
            for part in read_owned(file):
                size, crc = size + len(part), zlib.crc32(part, crc)
            found[os.path.relpath(file, folder)] = size, crc
    return found


@cache
def versions() -> dict[str, str]:
    """Return the versions that every result records: library → version, for handbench and the
    libraries that it uses; without those that are not installed, which only a part of handbench
    needs."""
    found = {}
    for name in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found
