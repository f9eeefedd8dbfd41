"""The hand of MAROON's radar frame: told by alignment.json, and decided by a surface where there is one.

Their code draws a left-handed radar frame, x to the right, so that the matrix from a right-handed sensor contains a
reflection. Without one the frame is right-handed as ours, or the sensor's points are a mirror image. Both readings of a
file place its surface before the radar, one the mirror image of the other in x; the radar's own depth tells them apart,
unless the object is its own mirror image.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.datasets.maroon_alignment import load_alignment
from groundtruth.mesh.depth import depth_on_grid
from groundtruth.mesh.mesh_files import mesh
from radar.data.capture import RadarCapture
from radar.methods.registry import method
from radar.support.errors import HandbenchError
from radar.support.progress import say

PIXELS = {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.003}  # about x = 0
LOOK = {"x": PIXELS, "y": PIXELS, "coarse_filter_px": 3, "fine_filter_px": 1}  # 3-FSK, a ninth of the paper's pixels
FARTHEST_MM = 20.0  # what a pixel counts that is further off, or meets no surface
CLEAR_MM = 0.5  # by which the reading that the matrix does not suggest must fit better; below, the object is symmetric


class Handedness(NamedTuple):
    """mirrored: their x is ours negated; note: how it was found, in words."""

    mirrored: bool
    note: str


def read_handedness(
    file: Path,
    source: str,
    surface: Callable[[bool], tuple[np.ndarray, np.ndarray]] | None,
    echoes: Callable[[], RadarCapture],
) -> Handedness:
    """Handedness of an alignment file. surface: vertices [n, 3] in our radar frame and faces [m, 3] of what `source`
    saw, as one reading (mirrored) has it; None where there is none."""
    reflects = load_alignment(file, source, mirrored=False).scale < 0
    told = f"{source}2radar has {'a' if reflects else 'no'} reflection"
    if surface is None:
        return _said(file, reflects, f"{told}, and no surface is there to check it")
    try:
        chosen = method("3fsk")
        depth = chosen.run(echoes(), chosen.configure(LOOK, "handedness"), 0).depth
        reference_m = depth_on_grid(mesh(*surface(reflects)), depth.x_m, depth.y_m)
    except HandbenchError as error:
        return _said(file, reflects, f"{told}, which was not checked ({error})")
    on = np.isfinite(depth.z_m)
    off_mm = {}
    for mirrored, expected_m in ((reflects, reference_m), (not reflects, reference_m[:, ::-1])):
        error_mm = 1e3 * np.abs(depth.z_m - expected_m)[on]
        off_mm[mirrored] = float(np.minimum(np.nan_to_num(error_mm, nan=FARTHEST_MM), FARTHEST_MM).mean())
    gain_mm = off_mm[not reflects] - off_mm[reflects]
    if gain_mm < -CLEAR_MM:
        told += f", but its mirror image lies {-gain_mm:.1f} mm nearer to the radar's depth: its points are mirrored"
        return _said(file, not reflects, told)
    return _said(
        file, reflects, f"{told}; the mirror image of what it saw lies {gain_mm:+.1f} mm further off the radar's depth"
    )


def _said(file: Path, mirrored: bool, told: str) -> Handedness:
    note = f"{told}; x of its radar frame is {'negated' if mirrored else 'taken as it is'}"
    say(f"{file}: {note}")
    return Handedness(mirrored, note)
