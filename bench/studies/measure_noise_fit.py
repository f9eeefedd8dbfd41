"""Fit of the simulation's phase noise, so that 2-FSK has a given depth precision.

The precision is measured on the benchmark's scenes that measure it, with all their tones and the
same random numbers as in the benchmark's own repeats, so that the benchmark's table shows the
fitted value. It is that of one pixel a hand, which other tones can make another one.

    python -m handbench.bench.studies.measure_noise_fit BENCH.toml [--precision-mm 3.6]
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.evaluation.intervals import precision_mm
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echoes
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.stages.reconstruct import strongest_z_m
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.registry import PAIR_HZ, method
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load
from handbench.support.errors import HandbenchError

STEPS = 2  # precision is nearly proportional to the noise


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
    """Print the phase noise at which 2-FSK has a given precision on a benchmark's scenes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("benchmark", metavar="BENCH.toml", help="file, or name of an included one")
    parser.add_argument("--precision-mm", type=float, default=3.6, help="default 3.6, the paper's")
    options = parser.parse_args()
    try:
        print(f"fitted: {fit(options.benchmark, options.precision_mm):.5f} rad")
    except HandbenchError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
