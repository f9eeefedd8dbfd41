"""Checks that hold on any machine: results do not depend on the threads, kernels compile in seconds, and the engine is
as fast and as exact as it says."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial

import numpy as np

from bench.studies.columns import Record
from bench.studies.engine.frame_rows import relative_error
from bench.studies.engine.growth import TOLERANCE
from bench.studies.engine.scope import Inputs
from bench.studies.engine.turns import Work, room, timed
from radar.data.depthmap import DepthMap
from radar.imaging.api import image_points, image_volume
from radar.methods.fsk import three_tone
from radar.simulation.forward import simulate

BARS = (  # section, start of method or what, figure, least and most that is met, in words
    ("volume", "exact", "share_of_gemm", 0.5, None, "exact path's share of the matrix product's speed"),
    ("volume", "fast volume, 1e-3", "ratio_to_exact", 1500, None, ""),
    ("volume", "fast projection, 1e-3", "ratio_to_exact", 1500, None, ""),
    ("volume", "fast projection, 1e-3", "depth_deviation_mm", None, 0.01, ""),
    ("volume", "fast projection, 1e-3", "mask_difference_px", None, 5, ""),
    ("3-FSK frame", "fast, 1e-3", "frames_per_second", 30, None, ""),
    ("3-FSK frame", "fast, 1e-3", "ratio_to_exact", 10, None, ""),
    ("simulation", "fast, 1e-3", "ratio_to_exact", 40, None, ""),
    ("growth", "voxels", "exponent", None, 1.05, "cost over {}: exponent"),
    ("threads", "", "difference", None, 1e-6, "one thread or all: {}"),
    ("compilation", "", "seconds", None, 30.0, "seconds to compile all kernels"),
)
COMPILE = """
import time
import radar.imaging.api
from radar.warmup import compile_kernels
start = time.perf_counter()
compile_kernels()
print(time.perf_counter() - start)
"""


def bars(records: list[Record]) -> list[Record]:
    """A demand, the measured figure, and whether that is met, as far as it was measured."""
    claims = [record for record in records if record.get("met") is not None]
    met = [record for record in claims if record["met"]]
    all_met = {"expected": f"all {len(claims)}", "measured": len(met), "met": len(met) == len(claims)}
    found = [{"bar": "rows within their tolerance", **all_met}] if claims else []
    for section, start, figure, least, most, words in BARS:
        for record in records:
            what = str(record.get("method", record.get("what")))
            if record["section"] == section and what.startswith(start) and record.get(figure) is not None:
                value, expected = record[figure], f"≥ {least:g}" if most is None else f"≤ {most:g}"
                text = words.format(what) or f"{section}, {what}: {figure}"
                kept = value >= least if most is None else value <= most
                found.append({"bar": text, "expected": expected, "measured": value, "met": bool(kept)})
    return found


def thread_differences(inputs: Inputs) -> list[Record]:
    """Relative difference of every kind of result between one worker thread and all of them."""
    found = []
    for workers in ("1", ""):  # nothing: all
        with room(HANDBENCH_WORKERS=workers) as place:
            found.append({name: place.submit(timed, work, _values).result().kept for name, work in _works(inputs)})
    one, every = found
    return [{"section": "threads", "what": name, "difference": relative_error(every[name], one[name])} for name in one]


def _works(inputs: Inputs) -> list[tuple[str, Work]]:
    samples, tones_hz, array = inputs.samples["hand"], inputs.tones_hz, inputs.array
    points_m = inputs.scatterers.position_m[::50]
    return [
        ("exact image", partial(image_points, samples, tones_hz, array, points_m, None)),
        ("fast volume", partial(image_volume, samples, tones_hz, array, inputs.grid, TOLERANCE)),
        ("3-FSK frame", partial(three_tone, inputs.frame, inputs.scope.frame)),
        ("simulation", partial(simulate, inputs.scatterers, tones_hz, array, tolerance=TOLERANCE)),
    ]


def _values(result: np.ndarray | DepthMap) -> np.ndarray:
    """The compared values: of a depth map its depths, 0 off target."""
    return np.nan_to_num(result.z_m) if isinstance(result, DepthMap) else result


def compilation(inputs: Inputs) -> list[Record]:
    """Compiling every kernel in a fresh process with an empty cache, the imports apart."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run(
            [sys.executable, "-c", COMPILE], env=environment, check=True, capture_output=True, text=True
        )
    return [{"section": "compilation", "what": "all kernels", "seconds": float(done.stdout)}]
