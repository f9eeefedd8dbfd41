"""Checks that hold on any machine: cost grows as it should with finer steps, larger boxes, more
channels and tones; kernels compile in seconds, and the engine is as fast and as exact as it
says."""

import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from tests.bench.studies.columns import Record
from tests.bench.studies.engine.scope import Inputs, white_noise
from tests.bench.studies.engine.turns import Case, Work, interleaved

TOLERANCE = 1e-3


def growth(inputs: Inputs) -> list[Record]:
    """A record for each quantity: what grows, its sizes, seconds of each, plan seconds, and the
    fitted exponent."""
    scope, tones_hz = inputs.scope, inputs.tones_hz

    def volume(
        grid: VoxelGrid = inputs.grid,
        array: AntennaArray = inputs.array,
        tones_hz: np.ndarray = tones_hz,
    ) -> Work:
        samples = white_noise((len(tones_hz), *array.channels))
        return partial(image_volume, samples, tones_hz, array, grid, TOLERANCE)

    def of_grids(grids: Iterable[VoxelGrid]) -> dict[int, Work]:
        return {int(np.prod(grid.shape)): volume(grid=grid) for grid in grids}

    grown = {
        "voxels, finer steps": of_grids(finer(inputs.grid, factor) for factor in scope.growth),
        "voxels, larger box": of_grids(larger(inputs.grid, factor) for factor in scope.growth),
        "channels": {
            count**2: volume(array=resampled(inputs.array, count)) for count in scope.channels
        },
        "tones": {
            n: volume(tones_hz=np.linspace(tones_hz[0], tones_hz[-1], n)) for n in scope.tones
        },
    }
    return [_series(what, steps) for what, steps in grown.items()]


def _series(what: str, steps: dict[int, Work]) -> Record:
    cases = [Case(f"{size:,}", work, repeats=2) for size, work in steps.items()]
    measured = interleaved(what, cases, apart=False).values()
    sizes, seconds = list(steps), [m.seconds for m in measured]
    return {
        "section": "growth",
        "what": what,
        "sizes": sizes,
        "seconds": seconds,
        "plan_seconds": [m.plan_s for m in measured],
        "exponent": exponent(sizes, seconds),
    }


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Slope of log(seconds) over log(sizes), by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def finer(grid: VoxelGrid, factor: float) -> VoxelGrid:
    """The same box with about `factor` times the voxels."""
    axes = (grid.x_m, grid.y_m, grid.z_m)
    return VoxelGrid(*(np.linspace(a[0], a[-1], round(len(a) * factor ** (1 / 3))) for a in axes))


def larger(grid: VoxelGrid, factor: float) -> VoxelGrid:
    """The same steps over a box of about `factor` times the volume; its near face and lateral
    centre stay."""
    axes = (grid.x_m, grid.y_m, grid.z_m)
    x, y, z = (np.arange(round(len(a) * factor ** (1 / 3))) * np.diff(a)[0] for a in axes)
    middle_x, middle_y = ((a[0] + a[-1]) / 2 for a in axes[:2])
    return VoxelGrid(x - x[-1] / 2 + middle_x, y - y[-1] / 2 + middle_y, z + grid.z_m[0])


def resampled(array: AntennaArray, count: int) -> AntennaArray:
    """`count` transmitters and receivers along the array's own sides."""

    def along(position_m: np.ndarray) -> np.ndarray:
        place, number = np.linspace(0, len(position_m) - 1, count), np.arange(len(position_m))
        return np.stack(
            [np.interp(place, number, coordinate) for coordinate in position_m.T], axis=1
        )

    return AntennaArray(along(array.tx_m), along(array.rx_m))


BARS = tomllib.loads(Path(__file__).with_name("bars.toml").read_text("utf-8"))["bar"]
COMPILE = """
import time
import handbench.radar.imaging.api
from handbench.radar.warmup import compile_kernels
start = time.perf_counter()
compile_kernels()
print(time.perf_counter() - start)
"""


def bars(records: list[Record]) -> list[Record]:
    """A demand, the measured figure, and whether that is met, as far as it was measured."""
    claims = [record for record in records if record.get("met") is not None]
    met = [record for record in claims if record["met"]]
    all_met = {
        "expected": f"all {len(claims)}",
        "measured": len(met),
        "met": len(met) == len(claims),
    }
    found = [{"bar": "rows within their tolerance", **all_met}] if claims else []
    for bar in BARS:
        for record in records:
            what, value = str(record.get("method", record.get("what"))), record.get(bar["figure"])
            if (
                record["section"] == bar["section"]
                and what.startswith(bar["what"])
                and value is not None
            ):
                kept = value >= bar["least"] if "least" in bar else value <= bar["most"]
                expected = f"≥ {bar['least']:g}" if "least" in bar else f"≤ {bar['most']:g}"
                text = (
                    bar["words"].format(what)
                    if "words" in bar
                    else f"{bar['section']}, {what}: {bar['figure']}"
                )
                found.append(
                    {"bar": text, "expected": expected, "measured": value, "met": bool(kept)}
                )
    return found


def compilation(inputs: Inputs) -> list[Record]:
    """Compiling every kernel in a fresh process with an empty cache, the imports apart."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        done = subprocess.run(
            [sys.executable, "-c", COMPILE],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
    return [{"section": "compilation", "what": "all kernels", "seconds": float(done.stdout)}]
