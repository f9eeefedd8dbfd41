"""Make the table and figure of docs/measurements/planar_scan.md: python docs/planar_scan.py CAPTURE
OUT.png

CAPTURE is a folder that `handbench import planar_scan` has written.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from handbench.bench.datasets.native import NativeCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import methods

BORDER_M = 0.03  # the scan's edge sees half an aperture
FLAW_M = ((-0.125, -0.055), (-0.015, 0.070))  # corners of a box around the flaw


def about_plane_m(depth: DepthMap) -> tuple[np.ndarray, np.ndarray]:
    """Return the depths [n] of the panel, without its flaw and its border, and their residuals [n]
    about the fitted plane, metres."""
    x, y = np.meshgrid(depth.x_m, depth.y_m)
    (x0, y0), (x1, y1) = FLAW_M
    inner = (np.abs(x) < depth.x_m.max() - BORDER_M) & (np.abs(y) < depth.y_m.max() - BORDER_M)
    use = inner & ~((x > x0) & (x < x1) & (y > y0) & (y < y1)) & np.isfinite(depth.z_m)
    return depth.z_m[use], _residual_m(x[use], y[use], depth.z_m[use])


def without_outliers_m(depth: DepthMap) -> np.ndarray:
    """Return the residuals of the depths about the fitted plane, metres, without those further than
    three robust standard deviations from the median."""
    _, residual_m = about_plane_m(depth)
    centred = residual_m - np.median(residual_m)
    return residual_m[np.abs(centred) <= 3 * max(1.4826 * np.median(np.abs(centred)), 1e-6)]


def rms_mm(residual_m: np.ndarray) -> float:
    """Return the standard deviation of residuals in metres, mm."""
    return 1e3 * float(residual_m.std())


def _residual_m(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray) -> np.ndarray:
    plane = np.stack([x_m, y_m, np.ones_like(x_m)], axis=1)
    return z_m - plane @ np.linalg.lstsq(plane, z_m, rcond=None)[0]


def main(capture: Path, picture: Path) -> None:
    """Image the scan by four methods, print a table of the deviations from a plane, and draw depths
    and amplitudes."""
    description, echoes = NativeCapture(capture).about, NativeCapture(capture).echoes()
    figure, axes = plt.subplots(
        2, 4, figsize=(13, 5.4), sharex=True, sharey=True, layout="constrained"
    )
    print("method | median depth mm | RMS about a plane mm (all) | RMS mm (3σ) | left out")
    for column, method in zip(
        axes.T, (m for m in methods() if m.id in description.methods), strict=True
    ):
        settings = method.configure(description.methods[method.id], str(capture))
        depth = method.run(echoes, settings, 0).depth
        (z_m, residual_m), kept_m = about_plane_m(depth), without_outliers_m(depth)
        figures = f"{1e3 * np.median(z_m):.1f} | {rms_mm(residual_m):.2f} | {rms_mm(kept_m):.2f}"
        print(f"{method.id} | {figures} | {len(residual_m) - len(kept_m)}")
        extent = [1e3 * v for v in (depth.x_m[0], depth.x_m[-1], depth.y_m[0], depth.y_m[-1])]
        shown = column[0].imshow(
            1e3 * depth.z_m, origin="lower", extent=extent, vmin=70, vmax=130, cmap="viridis_r"
        )
        loud = column[1].imshow(
            depth.amplitude_db, origin="lower", extent=extent, vmin=-20, vmax=0, cmap="gray"
        )
        column[0].set(
            title=method.id, xlim=extent[1::-1]
        )  # as seen from the array: x grows to the left
        column[1].set_xlabel("x in mm")
    for row, mappable, label in zip(
        axes, (shown, loud), ("depth in mm", "amplitude in dB"), strict=True
    ):
        row[0].set_ylabel("y in mm")
        figure.colorbar(mappable, ax=row, label=label)
    figure.savefig(picture, dpi=90)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
