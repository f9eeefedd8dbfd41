"""No silent wrong answer: thousands of random hard scenes, and every pixel that is further off than
its σ allows.

The scenes are those of `random_scenes.py`. A depth map states its own error, σ, and flags pixels
whose phase may have wrapped. A pixel that is off by more than 5σ and bears no flag is a silent
wrong answer: such pixels are counted, by what makes the scene hard. Off means: from every depth
that the surface has within the pixel's resolution cell, for at an edge none of them is wrong.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pandas as pd

from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError
from handbench.support.parallel import workers
from handbench.support.progress import track
from tests.bench.studies.stability.random_scenes import (
    AXIS,
    KINDS,
    TROUBLES,
    WITHIN_M,
    Surface,
    recorded,
)
from tests.hard_cases.scenes import imaged
from tests.hard_cases.table import Table

SIGMAS = 5.0
KEYS = {"method": ("2fsk", "3fsk"), "surface": tuple(KINDS), "trouble": TROUBLES}


COUNTED = (
    "scenes",
    "refused",
    "pixels",
    "beyond",
    "flagged",
    "gross",
)  # what `scene` counts, in order


def table(seed: int = 0, scenes: int = 10_000) -> Table:
    """Count over `scenes` random scenes, drawn from `seed`; the same on any number of threads."""
    with ThreadPoolExecutor(workers()) as pool:
        drawn = track(
            pool.map(lambda number: scene(seed, number), range(scenes)), "random scenes", scenes
        )
        counts = pd.DataFrame(
            [line for lines in drawn for line in lines], columns=[*KEYS, *COUNTED]
        )
    rows: list[tuple[str | float, ...]] = []
    for key, names in KEYS.items():
        sums = counts.groupby(key)[list(COUNTED)].sum().reindex(names, fill_value=0)
        sums["silent_percent"] = 100 * (sums.beyond - sums.flagged) / sums.pixels.clip(lower=1)
        rows += sums.itertuples(name=None)
    whole = counts[list(COUNTED)].sum()
    return Table(
        title=f"{scenes} random hard scenes",
        text=f"{whole.pixels} pixels, {whole.beyond} off by more than {SIGMAS:g}σ of their own; "
        f"{whole.flagged} "
        f"of these are flagged, {whole.beyond - whole.flagged} are silent",
        columns=(
            "",
            "depth maps",
            "refused",
            "pixels",
            "beyond 5σ",
            "flagged",
            "silent, > 5 mm",
            "silent %",
        ),
        rows=tuple(rows),
    )


def scene(seed: int, number: int) -> list[tuple[str | int, ...]]:
    """One scene's depth maps: method, surface, trouble; whether it was refused; pixels that were
    given, those off by more than 5σ, of these flagged, and the silent ones that are off by more
    than 5 mm too."""
    rng = np.random.default_rng([seed, number])
    kind, trouble = list(KINDS)[number % len(KINDS)], TROUBLES[number // len(KINDS) % len(TROUBLES)]
    surface, middle_m = KINDS[kind](rng), rng.uniform(0.25, 0.35)
    capture, _ = recorded(surface, middle_m, trouble, rng)
    first_m = middle_m + rng.uniform(-0.1, 0.1)
    known: dict[str, Any] = {
        "x": AXIS,
        "y": AXIS,
        "off_axis": True,
        "first_depth_m": first_m,
        "tolerance": None,
    }
    lines: list[tuple[str | int, ...]] = []
    for name in KEYS["method"]:
        try:
            counts: tuple[int, ...] = (
                0,
                *_count(imaged(name, capture, **known), surface, middle_m),
            )
        except HandbenchError:
            counts = (1, 0, 0, 0, 0)
        lines.append((name, kind, trouble, 1, *counts))
    return lines


def _count(depth: DepthMap, surface: Surface, middle_m: float) -> tuple[int, ...]:
    assert depth.sigma_m is not None and depth.wrapped is not None
    given = np.isfinite(depth.z_m)
    y, x = (depth.y_m[:, None] + WITHIN_M[:, None, None, None], depth.x_m + WITHIN_M[:, None, None])
    within_m = middle_m + surface(*np.broadcast_arrays(x, y))
    beside_m = np.maximum(
        within_m.min(axis=(0, 1)) - depth.z_m, depth.z_m - within_m.max(axis=(0, 1))
    )
    error_m = np.maximum(beside_m, 0)[given]
    with np.errstate(invalid="ignore"):
        beyond = ~(error_m <= SIGMAS * depth.sigma_m[given])  # a σ that is no number covers nothing
    flagged = beyond & depth.wrapped[given]
    gross = beyond & ~flagged & (error_m > 5e-3)
    return tuple(int(pixels.sum()) for pixels in (given, beyond, flagged, gross))
