"""Studies: scripts that measure the speed and accuracy of handbench itself.

    python -m handbench.bench.studies engine [-o runs/bench.json]

Seconds and error of fast imaging and simulation, next to exact sums. The echoes are those of a hand
in front of the paper's array; grids and tones are the paper's. Seconds depend on the state of the
machine, so compare ratio_to_exact, a ratio of times of one run.

    python -m handbench.bench.studies noise BENCH.toml [--precision-mm 3.6]

The simulation's phase noise with which 2-FSK has a given depth precision. The precision is measured
on the benchmark's scenes that measure it, with all their tones and the same random numbers as in
the benchmark's own repeats, so that the benchmark's table shows the fitted value. It is that of one
pixel a hand, which other tones can make another one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.evaluation.intervals import precision_mm
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echo_scene, echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.stages.reconstruct import strongest_z_m
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.device import describe
from handbench.radar.methods.backprojection import Backprojection
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.registry import PAIR_HZ, method
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.scene import CENTRE_M, Noise
from handbench.radar.simulation.scene_echoes import front_facets
from handbench.support.compiled import clock_s
from handbench.support.config import load
from handbench.support.cost import machine
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.progress import track
from handbench.support.store import versions

TOLERANCE = 1e-3
REPEATS = 5
STEPS = 2  # of the noise: precision is nearly proportional to it


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

    Returns seconds (median of the repeats), plan_seconds (what the first call takes longer),
    exact_seconds, ratio_to_exact (exact seconds over fast ones) and relative_error (L2).
    """
    exact, exact_s = timed(partial(case.exact, tolerance=None))
    fast_whole = partial(case.whole, tolerance=TOLERANCE)
    fast, first_s = timed(fast_whole)
    seconds = median(timed(fast_whole)[1] for _ in range(repeats))
    return {
        "section": case.section,
        "tolerance": TOLERANCE,
        "seconds": seconds,
        "plan_seconds": max(first_s - seconds, 0.0),
        "exact_seconds": case.times * exact_s,
        "ratio_to_exact": case.times * exact_s / seconds,
        "relative_error": float(np.linalg.norm(fast[case.part] - exact) / np.linalg.norm(exact)),
    }


def timed(work: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """Call `work`. Returns its result and the seconds that it took, without compilation."""
    start_s = clock_s()
    return work(), clock_s() - start_s


def write_engine(path: Path) -> None:
    """Measure the three computations; print the table, and write it as a JSON file."""
    measured = cases(hand(), qar50(), Backprojection(), Fsk())
    rows = [measure(case) for case in track(measured, "engine")]
    facts = {**machine(), "imaging_device": describe()}
    write_json(path, {"machine": facts, "versions": versions(), "rows": rows})
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3g}".format))


def fit(benchmark: str, wanted_mm: float) -> float:
    """Find the phase noise in radians at which 2-FSK has the precision wanted_mm, and print each
    step. The first step is the closed form of a point scatterer, σ_z = c/(4πΔf)·σ_φ.

    benchmark: file, or name of an included one. Raises HandbenchError if none of its scenes
    measures the precision.
    """
    bench, base = load_benchmark(benchmark)
    scenes = []
    for source in bench.capture:
        if source.scene and "precision" in source.measures:
            file = load(SceneFile, base / source.scene, "a scene description")
            scenes.append(build(file.model_copy(update={"photos": None}), base))
    if not scenes:
        raise HandbenchError(
            f"{benchmark}: has no scene that measures the precision, to which the noise is "
            "fitted; add one"
        )
    turns_per_m = 2 * abs(PAIR_HZ[0] - PAIR_HZ[1]) / SPEED_OF_LIGHT_M_S
    phase_noise_rad = 2 * np.pi * turns_per_m * 1e-3 * wanted_mm
    for _ in range(STEPS):
        measured_mm = measured_precision_mm(scenes, phase_noise_rad, bench.repeats)
        print(f"{phase_noise_rad:.5f} rad: precision {measured_mm:.3f} mm")
        phase_noise_rad *= wanted_mm / measured_mm
    return phase_noise_rad


def measured_precision_mm(scenes: list[Scene], phase_noise_rad: float, repeats: int) -> float:
    """Simulate `repeats` frames of each scene with this phase noise, and return the depth precision
    of 2-FSK in mm, computed as in the benchmark."""
    hands = []
    for scene in scenes:
        file = scene.file.model_copy(update={"noise": Noise(phase_noise_rad=phase_noise_rad)})
        capture = echoes(replace(scene, file=file), repeats).capture
        chosen = method("2fsk")
        maps = [chosen.run(capture, chosen.defaults, frame) for frame in range(repeats)]
        hands.append(strongest_z_m(maps))
    return precision_mm(hands) or 0.0


def main() -> None:
    """Measure the three computations, print the table and write it as a JSON file; or print the
    phase noise at which 2-FSK has a given precision on a benchmark's scenes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    studies = parser.add_subparsers(dest="study", required=True)
    engine = studies.add_parser("engine", help="speed and error of fast imaging and simulation")
    engine.add_argument("-o", "--out", type=Path, default=Path("runs/bench.json"))
    noise = studies.add_parser("noise", help="the phase noise of a given precision")
    noise.add_argument("benchmark", metavar="BENCH.toml", help="file, or name of an included one")
    noise.add_argument("--precision-mm", type=float, default=3.6, help="default 3.6, the paper's")
    options = parser.parse_args()
    try:
        if options.study == "noise":
            print(f"fitted: {fit(options.benchmark, options.precision_mm):.5f} rad")
        else:
            write_engine(options.out)
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
