"""The one fitted number: the phase noise at which 2-FSK has a given precision.

    python -m bench.noise_fit paper_table --precision-mm 3.6

The depth of a pixel is proportional to its phase, so that the precision is proportional to the noise as long as it is
small: one measurement over many repeats gives the factor. The closed form, σ_z = c/(4πΔf)·σ_φ, is printed beside it.
"""

from __future__ import annotations

import argparse

import numpy as np

from bench.metrics import precision, strongest_scatterer_z_m
from bench.protocol import load_benchmark
from bench.scenes.echoes import echoes
from bench.scenes.scene import Noise, SceneFile, Sensor, build
from radar.arrays import SPEED_OF_LIGHT_M_S
from radar.config import load
from radar.fsk import TwoToneConfig, two_tone
from radar.progress import track

TRIAL_RAD = 0.03


def main() -> None:
    """Print the fitted phase noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("benchmark")
    parser.add_argument("--precision-mm", type=float, default=3.6)
    parser.add_argument("--repeats", type=int, default=100, help="the fit is good to 1/√(2 · hands · repeats)")
    options = parser.parse_args()
    config = TwoToneConfig()
    bench, base = load_benchmark(options.benchmark)
    hands = []
    for source in track(bench.capture, "noise fit"):
        scene = load(SceneFile, base / source.scene, "a scene description")
        tones = Sensor(array=scene.sensor.array, sweep=(), tones_hz=(config.f1_hz, config.f2_hz))
        update = {"noise": Noise(phase_noise_rad=TRIAL_RAD), "sensor": tones, "photos": None}
        capture = echoes(build(scene.model_copy(update=update), base), options.repeats)
        depths = [two_tone(capture, config, frame) for frame in range(options.repeats)]
        amplitude = np.stack([10 ** (d.amplitude_db / 20) for d in depths])
        hands.append(strongest_scatterer_z_m(np.stack([d.z_m for d in depths]), amplitude))
    measured_mm = precision(hands)["precision_mm"]
    closed_rad = 4 * np.pi * abs(config.f1_hz - config.f2_hz) / SPEED_OF_LIGHT_M_S * 1e-3 * options.precision_mm
    print(f"at {TRIAL_RAD} rad: {measured_mm:.3f} mm; per hand {[round(1e3 * np.std(z, ddof=1), 3) for z in hands]}")
    print(f"phase_noise_rad = {TRIAL_RAD * options.precision_mm / measured_mm:.4f} (closed form: {closed_rad:.4f})")


if __name__ == "__main__":
    main()
