"""Time and error of imaging the paper's volume on a CUDA device, or as array code on the processor.

The echoes are those of a bumpy surface at 0.28 m; grid, tones and array are the paper's.

python -m tests.radar.imaging.measure_gpu [--device cuda|cpu|numpy] [-o DIR]
"""

import argparse
import time
from pathlib import Path
from statistics import median

import pandas as pd

from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.device import describe, use_device
from handbench.radar.imaging.exact import imaging_error
from handbench.radar.methods.backprojection import Backprojection
from handbench.support.files import write_json, write_text
from handbench.support.store import versions
from tests.radar.simulated_points import bumpy, points_capture, surface_points

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
REPEATS = 10


def measure(tolerance: float) -> dict[str, float]:
    """Milliseconds of the first call, with the plan, and of the others (median); relative L2 error
    at random voxels against a direct sum in float64 on the processor. A volume is on the host when
    a call ends, so that the clock holds for a device too."""
    volume = Backprojection()
    capture = points_capture(surface_points(bumpy, 0.03, 5e-4), volume.frequencies_hz)
    frame = capture.samples[0], capture.frequencies_hz, capture.aperture, volume.voxels
    times_ms = []
    for _ in range(1 + REPEATS):
        start_s = time.perf_counter()
        image = image_volume(*frame, tolerance)
        times_ms.append(1e3 * (time.perf_counter() - start_s))
    times = {"first_ms": times_ms[0], "ms": median(times_ms[1:])}
    return {"tolerance": tolerance, **times, "error": imaging_error(image, *frame)}


def main() -> None:
    """Measure at each tolerance; write gpu.json and gpu.md, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--device", choices=("cuda", "cpu", "numpy"), default="cuda")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/gpu"))
    options = parser.parse_args()
    with use_device(options.device):
        rows = [measure(tolerance) for tolerance in TOLERANCES]
        facts = {"device": describe(), "versions": versions(), "rows": rows}
    table = pd.DataFrame(rows).to_string(index=False, float_format="{:.3g}".format)
    write_json(options.out / "gpu.json", facts)
    write_text(options.out / "gpu.md", f"```\n{table}\n```\n")
    print(table)


if __name__ == "__main__":
    main()
