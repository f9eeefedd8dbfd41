"""`handbench doctor`: print what this machine has, and what to do where a part is missing."""

import argparse
import shutil

from handbench.groundtruth.cameras import cuda_devices, load_pycolmap
from handbench.radar.imaging.device import describe
from handbench.support.cost import machine
from handbench.support.errors import HandbenchError
from handbench.support.progress import print_wrapped
from handbench.support.rays import load_open3d
from handbench.support.store import versions

WANTED_DISK_GB = 5
WANTED_MEMORY_GB = 8


def run(options: argparse.Namespace) -> None:
    """Print this machine's libraries and parts: each works ("ok"), or has to be seen to ("--")."""
    facts, free_gb = machine(), shutil.disk_usage(".").free / 1e9
    memory_gb = facts["memory_gb"]
    libraries = ", ".join(f"{name} {version}" for name, version in versions().items())
    _print(True, f"Python {facts['python']}, {libraries}")
    _print(True, f"processor: {facts['processor']}, {facts['cores']} cores")
    _print(memory_gb >= WANTED_MEMORY_GB, f"memory: {memory_gb:.0f} GB", "use smaller photographs")
    _print(free_gb >= WANTED_DISK_GB, f"free disk: {free_gb:.0f} GB", "`make table` needs 5 GB")
    for part, load in (
        ("compiled code", _require_cache),
        ("meshes", load_open3d),
        ("photographs", load_pycolmap),
        ("imaging on a GPU", lambda: describe("cuda")),
        ("photographs on a GPU", _require_cuda),
    ):
        try:
            load()
            _print(True, part)
        except HandbenchError as error:
            _print(False, part, str(error))
        except (ImportError, OSError) as error:
            _print(False, part, f"{error}; run `make setup` again")


def _print(works: bool, part: str, otherwise: str = "") -> None:
    """Print whether a part works, and if it does not, what to do."""
    print_wrapped(f"ok  {part}" if works else f"--  {part}: {otherwise}", "    ")


def _require_cache() -> None:
    """Raise HandbenchError if no folder keeps compiled code from one command to the next."""
    from handbench.support.compiled import CACHE, COMPILE_S, KEPT

    if KEPT is None:
        raise HandbenchError(
            f"no folder for it can be written, so each command compiles for some {COMPILE_S} s; "
            f"set {CACHE} to one that can"
        )


def _require_cuda() -> None:
    """Raise HandbenchError if depth maps of photographs cannot be made on a graphics card."""
    if not cuda_devices():
        raise HandbenchError(
            "not found; depth maps take a minute or two per hand on the processor; with an NVIDIA "
            "card: pip install 'handbench[cuda]'"
        )
