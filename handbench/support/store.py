"""Work that is kept: stages, each in a folder named by the hash of everything that it depends on.

A stage's key is the hash of its parameters, of its inputs' content (or of the keys of the stages
that made them), and of all code that it runs, down to the libraries' versions (`support.code_hash`).
Nobody lists that code, so a changed input, option, source file or library never meets a stale
result.

A folder appears complete or not at all, so that work that was killed goes on where it stopped. Each
holds the checksums of its files, so that a flipped bit is found before it is taken for a result,
and a stamp that says what it cost.
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

MANIFEST, STAMP = (
    "manifest.json",
    "stage.json",
)  # in each folder: size and checksum of its files; what they cost
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
    """A call whose result is kept: `function`, of a module's top level, with the folder to fill and
    `arguments` (plain values and paths). Any machine that sees the files can make it.

    inputs: all that the result depends on besides code: values, paths of files, keys of earlier
    stages. capture and
    method: what it is of (empty: of none). plugged: what stands for code that no import leads to.
    code: the hash of all that runs; key: that of everything that the result depends on.
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
        """The name that is printed, and that the folder begins with."""
        return "-".join(part for part in (self.name, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """The place of its files, in the store at `root`."""
        return root / f"{self.label}-{self.key[:16]}"


@dataclass
class Stamp(Cost):
    """The cost of a stage when it was made, and facts of the machine that made it."""

    machine: dict[str, Any] = field(default_factory=dict)


def stage_code_hash(function: Callable[..., Any], plugged: tuple[str, ...] = ()) -> str:
    """Hash of the code that a function runs, the import closure of its module, as it was when this
    process first asked; plugged: what stands for code that no import leads to."""
    return content_hash(code_hash.key_of(function.__module__), plugged)


def cached(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """Have a stage's folder made in the store at `root`, unless it is there, whole; returns what
    the work cost when it was done, and whether it had been. A folder whose files have changed since
    is reported, deleted and made again."""
    require_owned(root)
    folder = stage.folder(root)
    if is_owned_folder(folder):
        if (wrong := changed(folder)) is None:
            return Stamp(**read_json(folder / STAMP, "a stage's stamp")), True
        say(f"{folder}: {wrong}; it is made again")
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
    """The files of a cached folder that are no longer as they were made, in words, or None."""
    try:
        written = json.loads(b"".join(read_owned(folder / MANIFEST)))
        expected = {name: tuple(facts) for name, facts in written.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, HandbenchError):
        return f"its {MANIFEST} is missing or broken"
    found = _checksums(folder)
    wrong = sorted(name for name in expected if expected[name] != found.get(name))
    if not wrong:
        return None
    return (
        f"{wrong[0]}{f' and {len(wrong) - 1} more' if len(wrong) > 1 else ''} differs from "
        "what was made (checksum)"
    )


def _checksums(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and CRC-32 of every file but the manifest's own: it finds what happens by chance, and
    takes 0.4 s/GB."""
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
    """Versions of the libraries that every result names."""
    return {name: metadata.version(name) for name in LIBRARIES}
