"""Work that is kept: folders named by the hash of everything that they depend on.

A folder appears complete or not at all, so that work that was killed goes on where it stopped, and a changed input,
option, source file or library never meets a stale result.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from radar.files import atomic_folder, content_hash

PACKAGES = Path(__file__).parent.parent
LIBRARIES = ("handbench", "numpy", "scipy", "numba", "open3d", "pycolmap", "opencv-contrib-python-headless", "h5py")


def versions() -> dict[str, str]:
    """Versions of the libraries that a result depends on."""
    return {name: metadata.version(name) for name in LIBRARIES}


@cache  # of the code as it was when the run began, which is the code that runs
def source_hash(sources: tuple[str, ...]) -> str:
    """Hash of the Python files of packages and modules, given as paths under the installation: radar, bench/x.py."""
    files = []
    for source in sources:
        path = PACKAGES / source
        files += [path] if path.is_file() else sorted(path.rglob("*.py"))
    return content_hash(*(part for file in files for part in (str(file.relative_to(PACKAGES)), file)))


def key_of(sources: tuple[str, ...], *depends_on: Any) -> str:
    """The hash that names a folder: of what its content depends on, of the code that makes it (`sources` as for
    `source_hash`) and of the libraries' versions."""
    return content_hash(*depends_on, source_hash(sources), versions())


def keep(folder: Path, make: Callable[[Path], None]) -> bool:
    """Have make(temporary) fill a folder unless it is there already; returns whether it was."""
    if folder.is_dir():
        return True
    with atomic_folder(folder) as temporary:
        make(temporary)
    return False
