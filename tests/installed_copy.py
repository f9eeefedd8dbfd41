"""A copy of handbench's code, laid out as it is installed, for tests that edit it or read it as
another tool does."""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("radar", "calibration", "groundtruth", "bench", "reports")


def copy_package(site: Path, compiled: bool = True) -> Path:
    """Copy the package into the folder `site`, without numba's compiled kernels unless `compiled`.

    Returns:
        The package's folder, site/handbench.
    """
    ignore = None if compiled else shutil.ignore_patterns("__pycache__")
    package = site / "handbench"
    shutil.copytree(ROOT / "handbench", package, ignore=ignore)
    for room in ROOMS:
        shutil.copytree(ROOT / room, package / room, ignore=ignore)
    return package
