"""The stage that scores a capture: it compares the depth maps with the references and writes these
files, for which this module also has the readers:

errors/       CAPTURE__METHOD__REFERENCE.npz: the signed errors (`ErrorMap`)
references/   REFERENCE-GRID.npz: the depths of a reference on the pixel grid of the methods, with
              the covariance of its registration (`Reference`)
scores.csv    the capture's lines of the table of scores (`SCORES`)
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.evaluation import scoring_protocols
from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.equal_treatment import taking_part, treated_figures
from handbench.bench.evaluation.metrics import (
    OVER_FRAMES,
    VELOCITY_BIAS,
    VELOCITY_MAE,
    Values,
    pool,
)
from handbench.bench.evaluation.scoring_protocols import Protocol
from handbench.bench.evaluation.tables import SCORES, frame, write
from handbench.bench.evaluation.treatments import SMOOTHING
from handbench.bench.evaluation.velocity_errors import mean_speed_m_s, velocity_figures
from handbench.bench.pipeline.score import reference_of_file, score, scored_z_m
from handbench.bench.results import errors_path, write_errors
from handbench.bench.results.derived import SPEED, START, STEP
from handbench.bench.run.reconstruct_stage import read_frames, read_times, read_treated
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.support.files import read_npz, write_npz

SCORED, REFERENCES = "scores.csv", "references"
OF_EACH_FRAME = (*OVER_FRAMES, VELOCITY_MAE, VELOCITY_BIAS)
KEPT = ("z_m", "mesh_sigma_m", "met", "leverage", "covariance")
Line = tuple[str, str, str, str, int, str, float | int | None]  # of SCORES


def make(
    folder: Path,
    capture: str,
    maps: Mapping[str, Path],
    references: Mapping[str, tuple[Path, Transform]],
    protocol: str,
) -> None:
    """Score one capture: compare its depth maps with its references, and write errors, references
    and scores into a stage's folder.
    maps: method → file of its depth map. references: name → mesh file, and the transform that moves
    the mesh into the radar frame. protocol: id of the scoring protocol. Raises HandbenchError for a
    file that cannot be read."""
    chosen, data = scoring_protocols.protocol(protocol), open_capture(capture)
    name, scores = data.about.name, list[Line]()
    pixels: dict[str, PixelGrid] = {}

    @cache  # methods that share a grid share the surfaces
    def at_start(truth: Path, grid: str) -> Reference:
        return reference_of_file(truth, identity("radar"), pixels[grid], exact=True)

    on_grid: dict[
        str, dict[str, Reference]
    ] = {}  # methods that share a grid share the references' depths
    grids: dict[str, str] = {}
    for method, file in maps.items():
        depth = load_depthmap(file)
        grid = grids[method] = grid_name(depth.x_m, depth.y_m)
        if grid not in on_grid:
            pixels[grid] = PixelGrid(depth.x_m, depth.y_m)
            on_grid[grid] = _on_grid(references, pixels[grid])
            for reference, known in on_grid[grid].items():
                write_reference(folder, reference, grid, known)
        further, times = read_frames(file.parent, depth)[1:], read_times(file.parent)
        truths = data.truths(1 + len(further))
        for reference, known in on_grid[grid].items():
            about = name, method, reference, ""
            found = score(depth, known, chosen, data)
            write_errors(folder, name, method, reference, found.errors)
            scores += _lines(about, 0, found.figures | _motion(depth, known, times, 0))
            if truths and reference != "truth":
                continue  # a measured surface of a moving scene is that of frame 0
            for number, later in enumerate(further, 1):
                now = at_start(truths[number], grid) if truths else known
                figures = _of_frame(later, now, chosen, data)
                figures |= _motion(later, now, times, number)
                scores += _lines(about, number, figures)
    first = next(iter(on_grid), "")
    depths = {
        m: treated
        for m, file in maps.items()
        if grids[m] == first and (treated := read_treated(file.parent))
    }
    for reference in references:
        for treatment in SMOOTHING:
            z_m = on_grid[first][reference].z_m
            several = taking_part({m: of[treatment] for m, of in depths.items()}, z_m)
            for method, figures in treated_figures(several, z_m).items():
                scores += _lines((name, method, reference, treatment), 0, figures)
    write(folder / SCORED, frame(SCORES, scores), SCORES)


def _lines(about: tuple[str, str, str, str], frame: int, figures: Values) -> Iterator[Line]:
    """Return the lines of the table of scores (SCORES) for the figures of one frame, one line for
    each metric.
    about: capture, method, reference and treatment."""
    return ((*about, frame, metric, value) for metric, value in figures.items())


def _on_grid(
    references: Mapping[str, tuple[Path, Transform]], grid: PixelGrid
) -> dict[str, Reference]:
    """Compute the depths of every reference at the pixels of a grid, by casting rays: name →
    Reference.
    references: name → mesh file, and the transform that moves the mesh into the radar frame."""
    found = {
        name: reference_of_file(*files, grid, exact=name == "truth")
        for name, files in references.items()
        if name != "completed"
    }
    if "completed" in references:
        found["completed"] = completed_by(found["photogrammetry"], found["truth"])
    return {name: found[name] for name in references}


def completed_by(reference: Reference, truth: Reference) -> Reference:
    """Fill the gaps of a measured reference with the true surface, which has no error.
    Both are given on one pixel grid, on which the result is returned."""
    own = np.isfinite(reference.z_m)
    met = truth.met if reference.met is None or truth.met is None else reference.met | truth.met
    return reference._replace(
        z_m=np.where(own, reference.z_m, truth.z_m),
        mesh_sigma_m=np.where(own, reference.mesh_sigma_m, truth.mesh_sigma_m),
        leverage=None
        if reference.leverage is None
        else np.where(own[..., None], reference.leverage, 0.0),
        met=met,
    )


def _of_frame(
    depth: DepthMap, reference: Reference, chosen: Protocol, data: NativeCapture
) -> Values:
    """Compute the figures of a frame after the first: metric → value.
    data: the capture, whose mask the protocol may use."""
    error_m = scored_z_m(depth, chosen, data) - reference.z_m
    figures = pool([ErrorMap(depth.x_m, depth.y_m, error_m, reference.z_m)])
    figures |= velocity_figures(depth, np.isfinite(error_m), reference)
    return {key: figures[key] for key in OF_EACH_FRAME if key in figures}


def _motion(depth: DepthMap, reference: Reference, times: Mapping[str, Any], frame: int) -> Values:
    """Return facts of the motion in a frame for the table of scores, as far as they are known: name
    → value. They are the start of the frame; and, if the surface moves or the map has velocities,
    the mean |radial velocity| of the surface, and the time from one tone to the next.
    times: content of the imaging stage's timing.json."""
    starts_s, speed_m_s = times.get("frame_times_s", []), mean_speed_m_s(reference)
    known = {START: starts_s[frame]} if starts_s else {}
    if speed_m_s is not None and (speed_m_s > 0 or depth.velocity_m_s is not None):
        known |= {SPEED: 1e3 * speed_m_s}
        known |= {STEP: times["step_time_s"]} if "step_time_s" in times else {}
    return known


def read_reference(
    folder: Path, capture: str, method: str, reference: str, transform: Transform
) -> Reference:
    """Read the depths of the reference with which a method's depth map was compared, at the pixels
    of that map.
    folder: of the scoring stage. transform: moved the reference to the radar frame; its covariance
    is replaced by the one that was stored with the depths."""
    grid = read_npz(errors_path(folder, capture, method, reference), ("x_m", "y_m"))
    path = _reference_path(folder, reference, grid_name(**grid))
    z_m, mesh_sigma_m, met, leverage, covariance = read_npz(path, KEPT).values()
    if not covariance.size:
        return Reference(z_m, mesh_sigma_m, None, None, met)
    registration = replace(transform, covariance=covariance)
    return Reference(z_m, mesh_sigma_m, leverage, registration, met)


def write_reference(folder: Path, name: str, grid: str, reference: Reference) -> None:
    """Write the depths of a reference on a pixel grid into the folder of a scoring stage.
    name: of the reference; grid: name of the pixel grid, as `grid_name` returns it."""
    known = reference.registration
    uncertain = (
        (np.empty(0), np.empty(0)) if known is None else (reference.leverage, known.covariance)
    )
    values = (reference.z_m, reference.mesh_sigma_m, reference.met, *uncertain)
    write_npz(_reference_path(folder, name, grid), **dict(zip(KEPT, values, strict=True)))


def grid_name(x_m: np.ndarray, y_m: np.ndarray) -> str:
    """Return a name that identifies a pixel grid: a hash of its centres x_m [nx], y_m [ny]."""
    return sha256(
        b"|".join(np.asarray(axis_m, np.float64).tobytes() for axis_m in (x_m, y_m))
    ).hexdigest()[:16]


def _reference_path(folder: Path, name: str, grid: str) -> Path:
    return folder / REFERENCES / f"{name}-{grid}.npz"
