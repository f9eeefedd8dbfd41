"""The one fitted number: the phase noise at which 2-FSK has a given precision.

    python -m bench.studies.noise_fit paper_table --precision-mm 3.6

The precision is that of the benchmark's own repeats, draw for draw, so that its table shows the fitted value;
--repeats takes more draws than the benchmark does and shows how far its few are from many. The closed form for a point
scatterer, σ_z = c/(4πΔf)·σ_φ, is printed beside it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.evaluation.metrics import precision
from bench.run.benchmark_file import load_benchmark
from bench.run.repeat_stage import strongest_z_m
from bench.scenes.build import Scene, build
from bench.scenes.echoes import echoes
from bench.scenes.scene_file import SceneFile, Sensor
from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.methods.fsk import TwoToneConfig, two_tone
from radar.simulation.causes import Noise
from radar.support.config import load
from radar.support.progress import track

STEPS = 3  # of the fixed-point iteration: precision is nearly proportional to the noise


def main() -> None:
    """Print the fitted phase noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("benchmark")
    parser.add_argument("--precision-mm", type=float, default=3.6)
    parser.add_argument("--repeats", type=int, help="default: the benchmark's")
    options = parser.parse_args()
    config = TwoToneConfig()
    bench, base = load_benchmark(options.benchmark)
    scenes = [_two_tone_scene(base / str(source.scene), base, config) for source in bench.capture]
    closed_rad = 4 * np.pi * abs(config.f1_hz - config.f2_hz) / SPEED_OF_LIGHT_M_S * 1e-3 * options.precision_mm
    print(f"closed form: {closed_rad:.4f} rad")
    phase_noise_rad = closed_rad
    for _ in track(range(STEPS), "noise fit"):
        measured_mm = precision_mm(scenes, config, phase_noise_rad, options.repeats or bench.repeats)
        print(f"phase_noise_rad = {phase_noise_rad:.5f}: {measured_mm:.3f} mm")
        phase_noise_rad *= options.precision_mm / measured_mm
    print(f"phase_noise_rad = {phase_noise_rad:.5f} (fitted)")


def precision_mm(scenes: list[Scene], config: TwoToneConfig, phase_noise_rad: float, repeats: int) -> float:
    """Precision of 2-FSK over the scenes at this noise, mm."""
    hands = []
    for scene in scenes:
        file = scene.file.model_copy(update={"noise": Noise(phase_noise_rad=phase_noise_rad)})
        capture = echoes(replace(scene, file=file), repeats).capture
        hands.append(strongest_z_m([two_tone(capture, config, frame) for frame in range(repeats)]))
    return float(precision(hands)["precision_mm"])


def _two_tone_scene(path: Path, folder: Path, config: TwoToneConfig) -> Scene:
    """A scene with the two tones alone and without photographs."""
    file = load(SceneFile, path, "a scene description")
    sensor = Sensor(array=file.sensor.array, sweep=(), tones_hz=(config.f1_hz, config.f2_hz))
    return build(file.model_copy(update={"sensor": sensor, "photos": None}), folder)


if __name__ == "__main__":
    main()
