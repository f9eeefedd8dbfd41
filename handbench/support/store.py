"""Work that is kept: stages, each in a folder named by the hash of everything that it depends on.

A stage's key is the hash of its parameters, of its inputs' content (or of the keys of the stages that made them), and
of all code that it runs, down to the libraries' versions (`support.closure`). Nobody lists that code, so a
changed input, option, source file or library never meets a stale result.

A folder appears complete or not at all, so that work that was killed goes on where it stopped. Each holds the checksums
of its files, so that a flipped bit is found before it is taken for a result, and a stamp that says what it cost.
"""

import json
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from handbench.support import closure
from handbench.support.cost import Cost, calibrated_machine, measured
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, content_hash, read_json, write_json
from handbench.support.folder import is_own_folder, own, read_own
from handbench.support.progress import say

MANIFEST, STAMP = "manifest.json", "stage.json"  # in each folder: size and checksum of its files; what they cost
LIBRARIES = ("handbench", "numpy", "scipy", "numba", "open3d", "pycolmap", "opencv-contrib-python-headless", "h5py")


@dataclass(frozen=True)
class Stage:
    """One piece of work as plain data, which any machine that sees the files can do. capture, method: what it is of
    (empty: of none); maker: "package.module:function", called with the folder to fill and `arguments` (plain values and
    paths); code: the hash of all that runs; key: that of everything that the result depends on."""

    name: str
    capture: str = ""
    method: str = ""
    maker: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)
    code: str = ""
    key: str = ""

    @property
    def label(self) -> str:
        """The name that is printed, and that the folder begins with."""
        return "-".join(part for part in (self.name, self.capture, self.method) if part)

    def folder(self, root: Path) -> Path:
        """The place of its files, in the store at `root`."""
        return root / f"{self.label}-{self.key[:16]}"

    def make(self, folder: Path) -> None:
        """Fill a folder."""
        module, _, function = self.maker.partition(":")
        getattr(import_module(module), function)(folder, **self.arguments)


@dataclass
class Stamp(Cost):
    """The cost of a stage when it was made, and facts of the machine that made it."""

    machine: dict[str, Any] = field(default_factory=dict)


def stage(
    name: str,
    maker: str,
    depends_on: list[Any],
    arguments: dict[str, Any],
    capture: str = "",
    method: str = "",
    plugged: tuple[str, ...] = (),
) -> Stage:
    """A stage whose key is the hash of depends_on (values, paths, keys of earlier stages) and of the code: the import
    closure of the maker's module, and `plugged`, which tells the code that no import leads to."""
    code = code_hash(maker, plugged)
    return Stage(name, capture, method, maker, arguments, code, content_hash(name, capture, method, *depends_on, code))


def code_hash(maker: str, plugged: tuple[str, ...] = ()) -> str:
    """Hash of the code that a maker runs, as it was when this process first asked."""
    return content_hash(closure.key_of(maker.partition(":")[0]), plugged)


def kept(root: Path, stage: Stage) -> tuple[Stamp, bool]:
    """Have a stage's folder made in the store at `root`, unless it is there; its stamp, and whether it was."""
    own(root)
    return kept_stage(stage.folder(root), stage.label, stage.make)


def kept_stage(folder: Path, label: str, make: Callable[[Path], None]) -> tuple[Stamp, bool]:
    """As `keep`, timed; returns what the work cost when it was done, and whether it had been."""
    stamps: list[Stamp] = []

    def timed(temporary: Path) -> None:
        say(f"{label} ...")
        machine = calibrated_machine()  # once, before anything is timed
        with measured() as cost:
            make(temporary)
        stamps.append(Stamp(**asdict(cost), machine=machine))
        write_json(temporary / STAMP, asdict(stamps[0]))

    if keep(folder, timed):
        return Stamp(**read_json(folder / STAMP, "a stage's stamp")), True
    return stamps[0], False


def keep(folder: Path, make: Callable[[Path], None]) -> bool:
    """Have make(temporary) fill a folder unless it is there already, whole; returns whether it was. What was changed
    since it was made (a disk's error, a hand's) is said, dropped and made again."""
    if is_own_folder(folder):
        wrong = changed(folder)
        if wrong is None:
            return True
        say(f"{folder}: {wrong}; it is made again")
    with atomic_folder(folder) as temporary:
        make(temporary)
        write_json(temporary / MANIFEST, _checksums(temporary))
    return False


def changed(folder: Path) -> str | None:
    """The files of a kept folder that are no longer as they were made, in words, or None."""
    try:
        written = json.loads(b"".join(read_own(folder / MANIFEST)))
        expected = {name: tuple(facts) for name, facts in written.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, HandbenchError):
        return f"its {MANIFEST} is missing or broken"
    found = _checksums(folder)
    wrong = sorted(name for name in expected if expected[name] != found.get(name))
    if not wrong:
        return None
    return f"{wrong[0]}{f' and {len(wrong) - 1} more' if len(wrong) > 1 else ''} differs from what was made (checksum)"


def _checksums(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and CRC-32 of every file but the manifest's own: it finds what happens by chance, and takes 0.4 s/GB."""
    found = {}
    for file in sorted(f"{at}/{name}" for at, _, names in os.walk(folder) for name in names):
        if file == f"{folder}/{MANIFEST}":
            continue
        with suppress(HandbenchError):  # what is no file of ours is none of those that were made
            size, crc = 0, 0
            for part in read_own(file):
                size, crc = size + len(part), zlib.crc32(part, crc)
            found[os.path.relpath(file, folder)] = size, crc
    return found


@cache
def versions() -> dict[str, str]:
    """Versions of the libraries that every result names."""
    return {name: metadata.version(name) for name in LIBRARIES}
