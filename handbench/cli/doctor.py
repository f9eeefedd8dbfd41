"""`handbench doctor`: check what this machine has, and what does not work without the parts that
are missing."""

import argparse
import importlib
import os
import shutil
from importlib.util import find_spec

from handbench.support.errors import HandbenchError

WANTED_DISK_GB, WANTED_MEMORY_GB = 5, 8


def run(options: argparse.Namespace) -> None:
    """Check this machine's hardware and libraries.
    Prints one line for each check: what was found, and "ok" or the consequence of what is
    missing."""
    for what, verdict in (*_hardware(), *_libraries()):
        print(f"{what:<58} {verdict}")


def _hardware() -> list[tuple[str, str]]:
    from handbench.support.cost import machine

    facts = machine()
    memory, disk = float(facts["memory_gb"]), shutil.disk_usage(os.getcwd()).free / 1e9
    return [
        (
            f"processor: {facts['processor']}, {facts['cores']} cores",
            "ok: work is spread over all of them",
        ),
        (
            f"memory: {memory:.0f} GB",
            "ok"
            if memory >= WANTED_MEMORY_GB
            else f"less than {WANTED_MEMORY_GB} GB: use smaller photographs",
        ),
        (
            f"free disk here: {disk:.0f} GB",
            "ok" if disk >= WANTED_DISK_GB else "little: make table needs about 5 GB",
        ),
        (f"BLAS: {_blas()}", "ok: exact imaging is matrix products, as fast as this library"),
        ("CUDA for COLMAP", _colmap_cuda()),
        ("CUDA for imaging (CuPy)", _cupy()),
        (f"Python {facts['python']}", "ok"),
    ]


def _libraries() -> list[tuple[str, str]]:
    from handbench.support.store import versions

    loaders = {
        "open3d": "handbench.support.rays:load_open3d",
        "pycolmap": "handbench.groundtruth.cameras.cameras:load_pycolmap",
    }
    found = [
        (f"{name} {version}", "ok") for name, version in versions().items() if name not in loaders
    ]
    for name, loader in loaders.items():
        module, function = loader.split(":")
        try:
            version = getattr(importlib.import_module(module), function)().__version__
            found.append((f"{name} {version}", "ok: imports"))
        except (ImportError, OSError) as error:
            found.append(
                (
                    name,
                    f"cannot be imported ({error}), so meshes and photographs do not work; run "
                    "`make setup` again",
                )
            )
    return found


def _blas() -> str:
    import numpy  # noqa: F401  loads the library that is asked about
    from threadpoolctl import threadpool_info

    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    if not pools:
        return "unknown"
    return f"{pools[0]['internal_api']} {pools[0]['version']} ({pools[0].get('architecture', '?')})"


def _colmap_cuda() -> str:
    from handbench.groundtruth.cameras.cameras import cuda_devices, load_pycolmap

    if cuda_devices():
        return "ok: depth maps of photographs are made there (--dense cpu: not)"
    if load_pycolmap().has_cuda:
        return (
            "present, but there is no device: depth maps are made on the CPU, a minute or two "
            "per hand"
        )
    return (
        "absent: depth maps are made on the CPU, a minute or two per hand; with an NVIDIA card, "
        "pip install 'handbench[cuda]'"
    )


def _cupy() -> str:
    if find_spec("cupy") is None:
        return "absent: imaging runs on the CPU; with an NVIDIA card, pip install 'handbench[gpu]'"
    from handbench.radar.imaging.device import describe

    try:
        return f"ok: --device cuda images on {describe('cuda').removeprefix('cuda: ')}"
    except HandbenchError as error:
        return f"present, but {error}"
