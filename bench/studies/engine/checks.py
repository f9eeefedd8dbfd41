"""Growth of the imaging time with finer steps, larger boxes, more channels and more tones. The
fitted exponents can be checked on any machine."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from handbench.bench.studies.engine.scope import Inputs, white_noise
from handbench.bench.studies.engine.turns import EngineCase, Work, interleaved
from handbench.bench.studies.study import Record
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume

TOLERANCE = 1e-3


def growth(inputs: Inputs) -> list[Record]:
    """Measure how the time of imaging grows with the number of voxels, channels and tones.

    Returns a record for each of these: the sizes, the seconds of imaging and of its preparation
    (the plan, computed once per geometry) at each size, and the exponent fitted to the seconds of
    imaging.
    """
    scope, tones_hz, grid, array = inputs.scope, inputs.tones_hz, inputs.grid, inputs.array
    grown: dict[str, dict[int, Work]] = {}
    for what, grow in (("voxels, finer steps", finer), ("voxels, larger box", larger)):
        grids = [grow(grid, factor) for factor in scope.growth]
        grown[what] = {int(np.prod(g.shape)): _volume(tones_hz, array, g) for g in grids}
    grown["channels"] = {
        count**2: _volume(tones_hz, resampled(array, count), grid) for count in scope.channels
    }
    grown["tones"] = {
        count: _volume(np.linspace(tones_hz[0], tones_hz[-1], count), array, grid)
        for count in scope.tones
    }
    return [_series(what, steps) for what, steps in grown.items()]


def _volume(tones_hz: np.ndarray, array: AntennaArray, grid: VoxelGrid) -> Work:
    samples = white_noise((len(tones_hz), *array.channels))
    return partial(image_volume, samples, tones_hz, array, grid, TOLERANCE)


def _series(what: str, steps: dict[int, Work]) -> Record:
    cases = [EngineCase(f"{size:,}", work, repeats=2) for size, work in steps.items()]
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
    """Fit the exponent of a power law: the slope of log(seconds) over log(sizes), by least
    squares."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def finer(grid: VoxelGrid, factor: float) -> VoxelGrid:
    """Return a grid over the same box with about `factor` times as many voxels."""
    axes = (grid.x_m, grid.y_m, grid.z_m)
    return VoxelGrid(*(np.linspace(a[0], a[-1], round(len(a) * factor ** (1 / 3))) for a in axes))


def larger(grid: VoxelGrid, factor: float) -> VoxelGrid:
    """Return a grid with the same steps over a box of about `factor` times the volume, with the
    same near face and lateral centre."""
    axes = (grid.x_m, grid.y_m, grid.z_m)
    x, y, z = (np.arange(round(len(a) * factor ** (1 / 3))) * np.diff(a)[0] for a in axes)
    x, y = (new - new.mean() + old.mean() for new, old in ((x, grid.x_m), (y, grid.y_m)))
    return VoxelGrid(x, y, z + grid.z_m[0])


def resampled(array: AntennaArray, count: int) -> AntennaArray:
    """Return an array of `count` transmitters and `count` receivers, spread evenly along the sides
    of the given array."""

    def along(position_m: np.ndarray) -> np.ndarray:
        place, number = np.linspace(0, len(position_m) - 1, count), np.arange(len(position_m))
        return np.stack(
            [np.interp(place, number, coordinate) for coordinate in position_m.T], axis=1
        )

    return AntennaArray(along(array.tx_m), along(array.rx_m))
