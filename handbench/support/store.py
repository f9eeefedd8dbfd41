"""The store of finished stages, each in a folder named by the hash of everything that it depends
on.

A stage's key is the hash of its parameters, of its inputs' content (or of the keys of the stages
that made them), and of all code that it runs, down to the libraries' versions
(`support.code_hash`). The code is found automatically, so a changed input, option, source file or
library never gives a stale result.

A folder appears complete or not at all, so that killed work resumes where it stopped. Each has the
checksums of its files, so that a flipped bit is found before the files are used, and a stamp with
the cost of making it.
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
    """A processing step whose result is kept on disk: a call of `function`, at a module's top
    level, with a folder to fill and `arguments` (plain values and paths). Any machine that sees
    these files can run it.

    name, capture, method: what the step is about (the last two may be empty). inputs: all that the
    result depends on besides code: values, paths of files, keys of earlier steps. plugged: values
    that stand for code that no import reaches. code: the hash of all code that runs. key: the hash
    of all that the result depends on.
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
        """The name that is printed, made of name, capture and method; the folder's name begins with
        it."""
        return "-".join(part for part in (self.name, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """Return the path of the folder with this step's result, in the store at `root`."""
        return root / f"{self.label}-{self.key[:16]}"


@dataclass
class Stamp(Cost):
    """What it cost to make a stored result, and facts of the machine that made it."""

    machine: dict[str, Any] = field(default_factory=dict)


def stage_code_hash(function: Callable[..., Any], plugged: tuple[str, ...] = ()) -> str:
    """Return the hash of all code that a function runs: its module and all that this imports, as
    this process first read them. plugged: values that stand for code that no import reaches."""
    return content_hash(code_hash.key_of(function.__module__), plugged)


def cached(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """Run a processing step, unless its complete result is in the store at `root`. Returns what it
    cost to make the result, and whether it was there. A result whose checksums do not match is
    reported and made again."""
    require_owned(root)
    folder = stage.folder(root)
    if is_owned_folder(folder):
        if (wrong := changed(folder)) is None:
            return Stamp(**read_json(folder / STAMP, "a stage's stamp")), True
        say(f"{folder}: {wrong}, so this step is computed again")
    say(f"{stage.label} ...")
    machine = calibrated_machine()  # once, before anything is timed
    with atomic_folder(folder) as temporary:
        with measured() as cost:
            stage.function(temporary, **stage.arguments)
        stamp = Stamp(**asdict(cost), machine=machine)
        write_json(temporary / STAMP, asdict(stamp))
        write_json(temporary / MANIFEST, _checksums(temporary))
    return stamp, False


def changed(folder: Path) -> str | None:
    """Return in words which files of a stored result differ from their checksums, or that the list
    of these is missing or broken; None if all is well."""
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
    """Return size in bytes and CRC-32 of every file below a folder except the manifest, by relative
    path. A CRC finds accidental changes and takes 0.4 s per GB."""
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
    """Return the versions of handbench and of the libraries that every result records, by name."""
    return {name: metadata.version(name) for name in LIBRARIES}
