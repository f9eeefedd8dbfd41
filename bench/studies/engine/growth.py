"""Growth of the fast engine's cost with finer steps, larger boxes, more channels and more tones."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from bench.studies.columns import Record
from bench.studies.engine.scope import Inputs, white_noise
from bench.studies.engine.turns import Case, interleaved
from radar.data.arrays import AntennaArray
from radar.data.grid import VoxelGrid
from radar.imaging.api import image_volume

TOLERANCE = 1e-3


def growth(inputs: Inputs) -> list[Record]:
    """A record for each quantity: what grows, its sizes, seconds of each, plan seconds, and the fitted exponent."""
    scope, grid, array, tones_hz = inputs.scope, inputs.grid, inputs.array, inputs.tones_hz
    noise = inputs.samples["noise"]

    def of_grid(grid: VoxelGrid) -> tuple[int, partial]:
        return int(np.prod(grid.shape)), partial(image_volume, noise, tones_hz, array, grid, TOLERANCE)

    def of_channels(count: int) -> tuple[int, partial]:
        of_count = resampled(array, count)
        samples = white_noise((len(tones_hz), *of_count.channels))
        return count**2, partial(image_volume, samples, tones_hz, of_count, grid, TOLERANCE)

    def of_tones(count: int) -> tuple[int, partial]:
        of_count_hz = np.linspace(tones_hz[0], tones_hz[-1], count)
        samples = white_noise((count, *array.channels))
        return count, partial(image_volume, samples, of_count_hz, array, grid, TOLERANCE)

    return [
        _series("voxels, finer steps", [of_grid(finer(grid, factor)) for factor in scope.growth]),
        _series("voxels, larger box", [of_grid(larger(grid, factor)) for factor in scope.growth]),
        _series("channels", [of_channels(count) for count in scope.channels]),
        _series("tones", [of_tones(count) for count in scope.tones]),
    ]


def _series(what: str, steps: Sequence[tuple[int, partial]]) -> Record:
    cases = [Case(f"{size:,}", work, repeats=2) for size, work in steps]
    measured = interleaved(what, cases, apart=False).values()
    sizes, seconds = [size for size, _ in steps], [m.seconds for m in measured]
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
    """The same steps over a box of about `factor` times the volume; its near face and lateral centre stay."""
    counts = [round(len(a) * factor ** (1 / 3)) for a in (grid.x_m, grid.y_m, grid.z_m)]
    x, y, z = (np.arange(n) * np.diff(a)[0] for n, a in zip(counts, (grid.x_m, grid.y_m, grid.z_m), strict=True))
    middle_x, middle_y = (grid.x_m[0] + grid.x_m[-1]) / 2, (grid.y_m[0] + grid.y_m[-1]) / 2
    return VoxelGrid(x - x[-1] / 2 + middle_x, y - y[-1] / 2 + middle_y, z + grid.z_m[0])


def resampled(array: AntennaArray, count: int) -> AntennaArray:
    """`count` transmitters and receivers along the array's own sides."""
    along_tx = np.linspace(0, len(array.tx_m) - 1, count)
    along_rx = np.linspace(0, len(array.rx_m) - 1, count)
    return AntennaArray(_at(array.tx_m, along_tx), _at(array.rx_m, along_rx))


def _at(position_m: np.ndarray, along: np.ndarray) -> np.ndarray:
    number = np.arange(len(position_m))
    return np.stack([np.interp(along, number, coordinate) for coordinate in position_m.T], axis=1)
