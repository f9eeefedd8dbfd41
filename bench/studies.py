"""A study of handbench itself: seconds and error of fast imaging and simulation, next to exact
sums.

    python -m handbench.bench.studies [-o runs/bench.json]

The echoes are those of a hand in front of the paper's array; grids and tones are the paper's.
Seconds depend on the state of the machine, so compare ratio_to_exact, a ratio of times of one run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.device import describe
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.scene import CENTRE_M
from handbench.radar.simulation.scene_echoes import front_facets
from handbench.support.compiled import clock_s
from handbench.support.cost import machine
from handbench.support.files import write_json
from handbench.support.progress import track
from handbench.support.store import versions

TOLERANCE = 1e-3
REPEATS = 5


@dataclass(frozen=True)
class EngineCase:
    """A computation to time.

    whole: computes it to a tolerance. exact: computes a part of it, which takes 1/times of the time
    when both are exact sums (tolerance None). part: index of that part in the whole.
    """

    section: str
    whole: Callable[..., np.ndarray]
    exact: Callable[..., np.ndarray]
    times: float = 1.0
    part: Any = ...


def hand() -> Scatterers:
    """Return the facets of a hand in the pose of the letter F that the centre of the array sees."""
    scene = build(SceneFile(version=1, name="F", target={"kind": "hand", "pose": "F"}))
    radar_scene = echo_scene(scene)
    facets = front_facets(radar_scene, radar_scene.body)
    rays = radar_scene.rays_of(radar_scene.body)
    return facets.where(rays.in_sight(facets.position_m, CENTRE_M))


def cases(
    scatterers: Scatterers, array: AntennaArray, volume: Backprojection, frame: Fsk
) -> list[EngineCase]:
    """List the three computations: a broadband volume, the images of a 3-FSK frame in a plane, and
    the echoes of a hand. The exact volume is timed on its middle plane."""
    tones_hz, frame_hz = volume.frequencies_hz, frame.frequencies_hz
    sums = partial(simulate, scatterers, tones_hz, array)
    frame_samples = simulate(scatterers, frame_hz, array)
    grid, middle = volume.voxels, volume.z.count // 2
    plane = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[middle, None])
    at_first = VoxelGrid(frame.x.values_m(), frame.y.values_m(), np.array([frame.first_depth_m]))
    image = partial(image_volume, sums(), tones_hz, array)
    images = partial(image_volume, frame_samples, frame_hz, array, at_first, per_tone=True)
    return [
        EngineCase(
            "volume",
            partial(image, grid),
            partial(image, plane),
            len(grid.z_m),
            np.s_[middle, None],
        ),
        EngineCase("3-FSK images", images, images),
        EngineCase("simulation", sums, sums),
    ]


def measure(case: EngineCase, repeats: int = REPEATS) -> dict[str, Any]:
    """Time a computation, and compare its result with exact sums.

    Returns seconds (median of the repeats), exact_seconds, ratio_to_exact (exact seconds over fast
    ones) and relative_error (L2).
    """
    exact, exact_s = timed(partial(case.exact, tolerance=None))
    fast_whole = partial(case.whole, tolerance=TOLERANCE)
    fast = fast_whole()
    seconds = median(timed(fast_whole)[1] for _ in range(repeats))
    return {
        "section": case.section,
        "tolerance": TOLERANCE,
        "seconds": seconds,
        "exact_seconds": case.times * exact_s,
        "ratio_to_exact": case.times * exact_s / seconds,
        "relative_error": float(np.linalg.norm(fast[case.part] - exact) / np.linalg.norm(exact)),
    }


def timed(work: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """Call `work`. Returns its result and the seconds that it took, without compilation."""
    start_s = clock_s()
    return work(), clock_s() - start_s


def main() -> None:
    """Measure the three computations; print the table, and write it as a JSON file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/bench.json"))
    out = parser.parse_args().out
    measured = cases(hand(), qar50(), Backprojection(), Fsk())
    rows = [measure(case) for case in track(measured, "engine")]
    facts = {**machine(), "imaging_device": describe()}
    write_json(out, {"machine": facts, "versions": versions(), "rows": rows})
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    main()
