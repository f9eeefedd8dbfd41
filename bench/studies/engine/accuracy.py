"""What has to hold on any machine: results do not depend on the threads, and kernels compile in seconds."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial
from typing import Any

import numpy as np

from bench.studies.engine.frame_rows import relative_error
from bench.studies.engine.growth import TOLERANCE
from bench.studies.engine.rooms import Room
from bench.studies.engine.rows import Row
from bench.studies.engine.scope import Inputs
from radar.data.depthmap import DepthMap
from radar.imaging.api import image_points, image_volume
from radar.methods.fsk import three_tone
from radar.simulation.forward import simulate

GEMM_SHARE, EXPONENT, THREADS, COMPILE_S = 0.5, 1.05, 1e-6, 30.0
AT_LEAST = {
    ("volume", "fast volume, 1e-3"): {"ratio_to_exact": 1500},
    ("volume", "fast projection, 1e-3"): {"ratio_to_exact": 1500},
    ("3-FSK frame", "fast, 1e-3"): {"frames_per_second": 30, "ratio_to_exact": 10},
    ("simulation", "fast, 1e-3"): {"ratio_to_exact": 40},
}
AT_MOST = {("volume", "fast projection, 1e-3"): {"depth_deviation_mm": 0.01, "mask_difference_px": 5}}
COMPILE = """
import time
import radar.imaging.api
from radar.warmup import compile_kernels
start = time.perf_counter()
compile_kernels()
print(time.perf_counter() - start)
"""


def bars(rows: list[Row], growth: list[dict[str, Any]], threads: dict[str, float], compile_s: float) -> list[dict]:
    """What was asked for, what was measured, and whether that is met."""
    [share] = [row.share_of_gemm for row in rows if row.share_of_gemm is not None]
    claims = [row for row in rows if row.met is not None]
    unmet = [f"{row.section}: {row.method}" for row in claims if not row.met]
    checks = [_bar("exact path's share of the matrix product's speed", share, share >= GEMM_SHARE, f"≥ {GEMM_SHARE}")]
    checks.append(_bar("rows within their tolerance", len(claims) - len(unmet), not unmet, f"all {len(claims)}"))
    for row in rows:
        what, found = f"{row.section}, {row.method}", vars(row)
        for name, least in AT_LEAST.get((row.section, row.method), {}).items():
            checks.append(_bar(f"{what}: {name}", found[name], found[name] >= least, f"≥ {least:g}"))
        for name, most in AT_MOST.get((row.section, row.method), {}).items():
            checks.append(_bar(f"{what}: {name}", found[name], found[name] <= most, f"≤ {most:g}"))
    for entry in growth:
        if entry["what"].startswith("voxels"):
            grows = entry["exponent"]
            checks.append(_bar(f"cost over {entry['what']}: exponent", grows, grows <= EXPONENT, f"≤ {EXPONENT}"))
    for what, difference in threads.items():
        checks.append(_bar(f"one thread or all: {what}", difference, difference <= THREADS, f"≤ {THREADS:g}"))
    checks.append(_bar("seconds to compile all kernels", compile_s, compile_s <= COMPILE_S, f"≤ {COMPILE_S:g}"))
    return checks


def thread_differences(inputs: Inputs) -> dict[str, float]:
    """Relative difference of every kind of result between one worker thread and all of them."""
    found = []
    for workers in ("1", ""):  # nothing: all
        with Room(HANDBENCH_WORKERS=workers) as room:
            found.append({name: room.time(work, _values).kept for name, work in _works(inputs).items()})
    one, every = found
    return {name: relative_error(every[name], one[name]) for name in one}


def _works(inputs: Inputs) -> dict[str, partial]:
    samples, tones_hz, array = inputs.samples["hand"], inputs.tones_hz, inputs.array
    points_m = inputs.scatterers.position_m[::50]
    return {
        "exact image": partial(image_points, samples, tones_hz, array, points_m, None),
        "fast volume": partial(image_volume, samples, tones_hz, array, inputs.grid, TOLERANCE),
        "3-FSK frame": partial(three_tone, inputs.frame, inputs.scope.frame),
        "simulation": partial(simulate, inputs.scatterers, tones_hz, array, tolerance=TOLERANCE),
    }


def _values(result: np.ndarray | DepthMap) -> np.ndarray:
    """What is compared: of a depth map its depths, 0 off target."""
    return np.nan_to_num(result.z_m) if isinstance(result, DepthMap) else result


def compile_seconds() -> float:
    """Compiling every kernel in a fresh process with an empty cache, the imports apart."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run(
            [sys.executable, "-c", COMPILE], env=environment, check=True, capture_output=True, text=True
        )
    return float(done.stdout)


def _bar(what: str, measured: float, met: bool, expected: str) -> dict[str, Any]:
    return {"bar": what, "expected": expected, "measured": measured, "met": bool(met)}
