"""Memory that is free, asked before it is taken: imaging may take a quarter of the machine's, or what
HANDBENCH_MEMORY_GB says; other work what is free."""

from __future__ import annotations

import os

import psutil

from radar.support.errors import HandbenchError


def limit_bytes() -> float:
    """The limit in bytes."""
    wanted = os.environ.get("HANDBENCH_MEMORY_GB", "")
    try:
        limit = float(wanted) * 1e9 if wanted else psutil.virtual_memory().total / 4
    except ValueError:
        limit = 0.0
    if not limit > 0:
        raise HandbenchError(f"HANDBENCH_MEMORY_GB: is '{wanted}'; expected a positive number of gigabytes, or nothing")
    return limit


def require_memory(needed_bytes: float, what: str) -> None:
    """Refuse what does not fit, with its size and what would."""
    limit = limit_bytes()
    if needed_bytes > limit:
        coarser = (needed_bytes / limit) ** (1 / 3)
        raise HandbenchError(
            f"{what}: needs {needed_bytes / 1e9:.3g} GB, more than the limit of {limit / 1e9:.3g} GB; steps "
            f"{coarser:.2g} times larger would fit, a depth map without --volume needs less, or raise "
            "HANDBENCH_MEMORY_GB"
        )


def require_free(needed_bytes: float, what: str, advice: str) -> None:
    """Refuse what does not fit into the memory that is free now, with its size, before it is tried."""
    free = psutil.virtual_memory().available
    if needed_bytes > free:
        raise HandbenchError(
            f"{what}: needs {needed_bytes / 1e9:.3g} GB, and {free / 1e9:.3g} GB of memory are free; {advice}"
        )
