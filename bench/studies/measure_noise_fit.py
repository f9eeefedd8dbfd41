"""Fit of the simulation's phase noise, so that 2-FSK has a given depth precision.

The precision is measured on the benchmark's scenes that measure it, with the same random numbers as
in the benchmark's own repeats, so that the benchmark's table shows the fitted value. A larger
number of --repeats shows how well the benchmark's few repeats represent many.

    python -m handbench.bench.studies.measure_noise_fit
        BENCH.toml [--precision-mm 3.6] [--repeats N]
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from handbench.bench.evaluation.metrics import precision
from handbench.bench.evaluation.tables import Column
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.repeat_stage import strongest_z_m
from handbench.bench.scenes.build import Scene, build
from handbench.bench.scenes.echoes import echoes
from handbench.bench.scenes.scene_file import SceneFile, Sensor
from handbench.bench.studies.study import Record, Study, Table, measured, parser
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import TwoToneConfig
from handbench.radar.simulation.causes import Noise
from handbench.support.config import load
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

STEPS = 3  # of the fixed-point iteration: precision is nearly proportional to the noise
STEP = "of the iteration, from the closed form of a point scatterer, σ_z = c/(4πΔf)·σ_φ"
NOISE, FOUND = "standard deviation of the phase noise", "precision of 2-FSK at this noise"
COLUMNS = (
    Column("step", str, STEP, heading="step"),
    Column("phase_noise_rad", float, NOISE, heading="phase_noise_rad", form="{:.5f}"),
    Column("precision_mm", float, FOUND, heading="precision mm", form="{:.3f}"),
)


def study(work: Path, benchmark: str, precision_mm: float, repeats: int | None) -> Study:
    """Make the study that finds the phase noise at which 2-FSK has the precision `precision_mm` on
    a benchmark's scenes. repeats: frames with new noise per scene (None: as many as in the
    benchmark)."""
    return Study(
        "noise-fit",
        [benchmark],
        lambda benchmark: fit(benchmark, precision_mm, repeats),
        lambda records: [Table("rows", COLUMNS, records)],
    )


def fit(benchmark: str, wanted_mm: float, repeats: int | None) -> list[Record]:
    """Find the phase noise in radians at which 2-FSK has the precision wanted_mm. Returns a record
    for each iteration, and one with the fitted noise.

    benchmark: file, or name of an included one; its scenes that measure the precision are used.
    repeats: frames with new noise per scene (None: as many as in the benchmark). Raises
    HandbenchError if no scene measures the precision.
    """
    config = TwoToneConfig()
    bench, base = load_benchmark(benchmark)
    scenes = []
    for source in bench.capture:
        if source.scene and "precision" in source.measures:
            file = load(SceneFile, base / source.scene, "a scene description")
            tones_hz = config.f1_hz, config.f2_hz
            sensor = Sensor(array=file.sensor.array, sweep=(), tones_hz=tones_hz)
            scenes.append(build(file.model_copy(update={"sensor": sensor, "photos": None}), base))
    if not scenes:
        raise HandbenchError(
            f"{benchmark}: has no scene that measures the precision, to which the noise is "
            "fitted; add one"
        )
    turns_per_m = 2 * abs(config.f1_hz - config.f2_hz) / SPEED_OF_LIGHT_M_S
    phase_noise_rad, found = 2 * np.pi * turns_per_m * 1e-3 * wanted_mm, []
    for step in track(["closed form", *map(str, range(2, STEPS + 1))], "noise fit"):
        measured_mm = precision_mm(scenes, config, phase_noise_rad, repeats or bench.repeats)
        about = {"step": step, "phase_noise_rad": phase_noise_rad, "precision_mm": measured_mm}
        found.append(about)
        phase_noise_rad *= wanted_mm / measured_mm
    return [*found, {"step": "fitted", "phase_noise_rad": phase_noise_rad}]


def precision_mm(
    scenes: list[Scene], config: TwoToneConfig, phase_noise_rad: float, repeats: int
) -> float:
    """Simulate `repeats` frames of each scene with this phase noise, and return the depth precision
    of 2-FSK in mm, computed as in the benchmark."""
    hands = []
    for scene in scenes:
        file = scene.file.model_copy(update={"noise": Noise(phase_noise_rad=phase_noise_rad)})
        capture = echoes(replace(scene, file=file), repeats).capture
        maps = [fsk_with_uncertainty(capture, config, frame) for frame in range(repeats)]
        hands.append(strongest_z_m(maps))
    return float(Record(precision(hands))["precision_mm"])


def main() -> None:
    """Fit the phase noise at which 2-FSK has a given precision on a benchmark's scenes; write and
    print the noise and the precision of each iteration."""
    options = parser("measure_noise_fit", "the phase noise at which 2-FSK has a given precision")
    benchmark = "benchmark file, or the name of an embedded one"
    options.add_argument("benchmark", metavar="BENCH.toml", help=benchmark)
    paper = "default 3.6, the paper's"
    options.add_argument("--precision-mm", type=float, default=3.6, help=paper)
    draws = "draws of the noise (default: the benchmark's)"
    options.add_argument("--repeats", type=int, help=draws)
    measured(options, study, "noise-fit")


if __name__ == "__main__":
    main()
