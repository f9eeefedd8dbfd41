"""The figures of docs/planar_scan.md: python docs/planar_scan.py CAPTURE OUT.png (CAPTURE from `handbench import`)."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from bench.datasets.native import load_capture_file, load_echoes
from bench.registry import methods
from radar.depthmap import DepthMap

BORDER_M = 0.03  # the scan's edge sees half an aperture
FLAW_M = ((-0.125, -0.055), (-0.015, 0.070))  # corners of a box around the flaw


def plane_rms_m(depth: DepthMap) -> tuple[float, float, int]:
    """Median depth, RMS about the fitted plane (after leaving out what lies further than 3 robust standard deviations
    from it) and the number of pixels left out, over the unflawed part of the panel."""
    x, y = np.meshgrid(depth.x_m, depth.y_m)
    (x0, y0), (x1, y1) = FLAW_M
    inner = (np.abs(x) < depth.x_m.max() - BORDER_M) & (np.abs(y) < depth.y_m.max() - BORDER_M)
    use = inner & ~((x > x0) & (x < x1) & (y > y0) & (y < y1)) & np.isfinite(depth.z_m)
    a, z = np.stack([x[use], y[use], np.ones(use.sum())], axis=1), depth.z_m[use]
    residual = z - a @ np.linalg.lstsq(a, z, rcond=None)[0]
    spread = 1.4826 * np.median(np.abs(residual - np.median(residual)))
    keep = np.abs(residual - np.median(residual)) <= 3 * max(spread, 1e-6)
    residual = z[keep] - a[keep] @ np.linalg.lstsq(a[keep], z[keep], rcond=None)[0]
    return float(np.median(z)), float(np.sqrt(np.mean(residual**2))), int((~keep).sum())


def plane_rms_all_m(depth: DepthMap) -> float:
    """RMS about the fitted plane with every pixel of the unflawed part."""
    x, y = np.meshgrid(depth.x_m, depth.y_m)
    (x0, y0), (x1, y1) = FLAW_M
    inner = (np.abs(x) < depth.x_m.max() - BORDER_M) & (np.abs(y) < depth.y_m.max() - BORDER_M)
    use = inner & ~((x > x0) & (x < x1) & (y > y0) & (y < y1)) & np.isfinite(depth.z_m)
    a, z = np.stack([x[use], y[use], np.ones(use.sum())], axis=1), depth.z_m[use]
    return float(np.sqrt(np.mean((z - a @ np.linalg.lstsq(a, z, rcond=None)[0]) ** 2)))


def main(capture: Path, picture: Path) -> None:
    """Run the four methods, print the table, draw depth and amplitude."""
    description, echoes = load_capture_file(capture), load_echoes(capture)
    figure, axes = plt.subplots(2, 4, figsize=(13, 5.4), sharex=True, sharey=True, layout="constrained")
    print("method | median depth mm | RMS about a plane mm (all) | RMS mm (3σ) | left out")
    for column, method in zip(axes.T, methods(), strict=True):
        settings = method.configure(description.methods[method.id], str(capture))
        depth = method.run(echoes, settings, 0).depth
        median, rms, out = plane_rms_m(depth)
        print(f"{method.id} | {1e3 * median:.1f} | {1e3 * plane_rms_all_m(depth):.2f} | {1e3 * rms:.2f} | {out}")
        extent = [1e3 * v for v in (depth.x_m[0], depth.x_m[-1], depth.y_m[0], depth.y_m[-1])]
        shown = column[0].imshow(1e3 * depth.z_m, origin="lower", extent=extent, vmin=70, vmax=130, cmap="viridis")
        loud = column[1].imshow(depth.amplitude_db, origin="lower", extent=extent, vmin=-20, vmax=0, cmap="gray")
        column[0].set_title(method.id)
        column[1].set_xlabel("x in mm")
    for row, mappable, label in zip(axes, (shown, loud), ("depth in mm", "amplitude in dB"), strict=True):
        row[0].set_ylabel("y in mm")
        figure.colorbar(mappable, ax=row, label=label)
    figure.savefig(picture, dpi=90)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
