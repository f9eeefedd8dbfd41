"""What imaging costs: every path of the engine on one cut of the paper's volume, as ratios within one run.

    python -m bench.engine_benchmark -o runs/bench.json

The echoes are those of a bumpy surface at 0.28 m. Seconds drift with the machine; ratio_to_exact is what counts.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.measure import machine, measured
from radar.arrays import qar50
from radar.backprojection import compile_kernels, direct_sum
from radar.capture import RadarCapture
from radar.files import write_json
from radar.forward import Scatterers, simulate
from radar.fsk import ThreeToneConfig, three_tone
from radar.grid import Axis
from radar.progress import say
from radar.surface import BroadbandConfig, maximum_projection
from radar.tones import ToneSkeleton
from radar.volume import image_volume

LATERAL = Axis(start_m=-0.03, stop_m=0.03, step_m=0.001)
CHECKED = 50  # voxels at which the exact path is compared with the float64 direct sum


def main() -> None:
    """Measure, print and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True)
    out = parser.parse_args().out
    compile_kernels()
    rows = volume_rows() + [frame_row()]
    write_json(out, {"machine": machine(), "rows": rows})
    for row in rows:
        say("  ".join(f"{key}={value:.3g}" if isinstance(value, float) else f"{value}" for key, value in row.items()))


def volume_rows() -> list[dict[str, Any]]:
    """The broadband volume: all tones, then tone skeletons at several tolerances."""
    config = BroadbandConfig(x=LATERAL, y=LATERAL)
    capture, grid = surface_echoes(config.tones_hz()), config.grid()
    tones_hz = capture.frequencies_hz

    def image(tolerance: float | None) -> Callable[[], np.ndarray]:
        return lambda: image_volume(capture.samples[0], tones_hz, capture.aperture, grid, tolerance)

    exact, seconds, memory = _timed(image(None))
    chosen = np.random.default_rng(0).integers(0, exact.size, CHECKED)
    reference = direct_sum(capture.samples[0], tones_hz, capture.aperture, grid.points_m().reshape(-1, 3)[chosen])
    flops = 8.0 * exact.size * np.prod(capture.aperture.channels)
    error = _relative(exact.ravel()[chosen], reference)
    rows = [_row("exact", seconds, 1.0, error, 0.0, len(tones_hz) * flops, memory)]
    surface = maximum_projection(exact, config, "exact").z_m
    for tolerance in (1e-6, 1e-4, 1e-2):
        fast, fast_seconds, memory = _timed(image(tolerance))
        deviation = np.nanmean(np.abs(maximum_projection(fast, config, "fast").z_m - surface))
        corners = np.array([[x, y, z] for x in (0, 0.02) for y in (0, 0.02) for z in (0.28, 0.304)]).T
        kept = len(ToneSkeleton(tones_hz, capture.aperture, corners, tolerance).frequencies_hz)
        rows.append(_row(
            f"tone skeleton {tolerance:.0e}", fast_seconds, seconds / fast_seconds, _relative(fast, exact),
            1e3 * float(deviation), kept * flops, memory,
        ))
    return rows


def frame_row() -> dict[str, Any]:
    """One whole 3-FSK frame with the paper's pixels."""
    config = ThreeToneConfig()
    capture = surface_echoes(np.array([config.f1_hz, config.f2_hz, config.f3_hz]))
    depth, seconds, memory = _timed(lambda: three_tone(capture, config))
    points = 4 * depth.z_m.size + 3 * int(np.isfinite(depth.z_m).sum())
    flops = 8.0 * points * np.prod(capture.aperture.channels)
    return _row("3-FSK frame", seconds, None, None, None, flops, memory)  # always exact: there is nothing to compare


def surface_echoes(frequencies_hz: np.ndarray) -> RadarCapture:
    """Echoes of a smooth bumpy surface, 6 × 6 cm."""
    x, y = np.meshgrid(np.linspace(-0.03, 0.03, 121), np.linspace(-0.03, 0.03, 121))
    z = 0.28 + 0.004 * np.sin(2 * np.pi * x / 0.03) * np.cos(2 * np.pi * y / 0.04)
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    samples = simulate(Scatterers(points, np.ones(len(points))), frequencies_hz, qar50())
    return RadarCapture(samples[None], frequencies_hz, qar50())


def _timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    with measured() as cost:
        result = work()
    return result, cost.seconds, cost.peak_memory_mb


def _relative(image: np.ndarray, reference: np.ndarray) -> float:
    return float(np.linalg.norm(image - reference) / np.linalg.norm(reference))


def _row(
    method: str,
    seconds: float,
    ratio: float | None,
    error: float | None,
    deviation_mm: float | None,
    flops: float,
    memory_mb: float,
) -> dict[str, Any]:
    return {
        "method": method,
        "seconds": seconds,
        "ratio_to_exact": ratio,
        "relative_error": error,
        "depth_deviation_mm": deviation_mm,
        "gflops": flops / seconds / 1e9,
        "peak_memory_mb": memory_mb,
    }


if __name__ == "__main__":
    main()
