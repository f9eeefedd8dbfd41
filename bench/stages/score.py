"""The stage that scores a capture: it compares the depth maps with the references and writes files
that the result of a run takes over:

errors/       CAPTURE__METHOD__REFERENCE.npz: the signed errors (`ErrorMap`)
depth/        CAPTURE__REFERENCE.npz: the depths of a reference at the pixels of the first method
scores.csv    the capture's lines of the table of scores (`SCORES`)
sigma.json    the uncertainty of the photogrammetric reference by source (`budget`)
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.evaluation import scoring_protocols
from handbench.bench.evaluation.depth_errors import (
    ErrorMap,
    budget,
    mean_speed_m_s,
    velocity_errors,
)
from handbench.bench.evaluation.metrics import TREATMENTS, Values, figures
from handbench.bench.evaluation.paired import taking_part, treated_figures
from handbench.bench.evaluation.score import reference_of_file, score, scored_z_m
from handbench.bench.evaluation.scoring_protocols import Protocol
from handbench.bench.evaluation.tables import SCORES, frame, write
from handbench.bench.results.derived import SPEED, START, STEP
from handbench.bench.results.maps import SurfaceMap, write_errors, write_surface
from handbench.bench.stages.reconstruct import read_frames, read_times, read_treated
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.support.files import write_json
from handbench.support.store import stage

SCORED = "scores.csv"
SIGMA = "sigma.json"
MEASURED = "photogrammetry"  # the reference that has an uncertainty
Surfaces = Mapping[str, tuple[str, Transform]]  # reference → mesh file, and radar_from_mesh


@stage(
    "score",
    "bench/stages/score.py",
    "bench/stages/image.py",
    "bench/stages/reconstruct.py",
    "bench/datasets",
    "bench/evaluation",
    "bench/results",
    "calibration",
    "groundtruth/mesh",
    "radar",
)
def score_capture(
    folder: Path, capture: str, maps: Mapping[str, str], references: Surfaces, protocol: str
) -> None:
    """Score one capture: compare its depth maps with its references, and write errors, references
    and scores into a stage's folder.
    maps: method → file of its depth map. references: name → mesh file, and the transform that moves
    the mesh into the radar frame. protocol: id of the scoring protocol. Raises HandbenchError for a
    file that cannot be read."""
    rules, data = scoring_protocols.protocol(protocol), open_capture(capture)
    name = data.about.name
    # methods that share a grid share the depths of the references
    surfaces: dict[bytes, dict[str, Reference]] = {}
    pixels: dict[bytes, PixelGrid] = {}
    later_truths: dict[tuple[bytes, int], Reference] = {}
    grids: dict[str, bytes] = {}
    scores: list[Any] = []
    for method, file in maps.items():
        depth = load_depthmap(Path(file))
        grid = PixelGrid(depth.x_m, depth.y_m)
        key = grids[method] = depth.x_m.tobytes() + b"|" + depth.y_m.tobytes()
        if key not in surfaces:
            pixels[key], surfaces[key] = grid, depths_on_grid(references, grid)
        imaged = Path(file).parent
        frames, times = read_frames(imaged, depth) or [depth], read_times(imaged)
        truths = data.truths(len(frames))
        for number, truth in enumerate(truths[1:], 1):
            if (key, number) not in later_truths:
                at_start = reference_of_file(truth, identity("radar"), grid, exact=True)
                later_truths[key, number] = at_start
        for reference, surface in surfaces[key].items():
            scored = score(depth, surface, rules, data)
            write_errors(folder, name, method, reference, scored.errors)
            of_frames = {0: scored.figures | _motion(depth, surface, times, 0)}
            # a measured surface of a moving scene is that of frame 0
            further = frames[1:] if reference == "truth" or not truths else []
            for number, later in enumerate(further, 1):
                there = later_truths.get((key, number), surface)
                values = _of_frame(later, there, rules, data)
                of_frames[number] = values | _motion(later, there, times, number)
            scores += [
                (name, method, reference, "", number, *figure)
                for number, values in of_frames.items()
                for figure in values.items()
            ]
    first = next(iter(surfaces))
    treated = {
        method: depths
        for method, file in maps.items()
        if grids[method] == first and (depths := read_treated(Path(file).parent))
    }
    for reference, surface in surfaces[first].items():
        for treatment in TREATMENTS:
            depths = {method: of[treatment] for method, of in treated.items()}
            equal = treated_figures(taking_part(depths, surface.z_m), surface.z_m)
            scores += [
                (name, method, reference, treatment, 0, *figure)
                for method, values in equal.items()
                for figure in values.items()
            ]
        on_pixels = pixels[first].x_m, pixels[first].y_m, surface.z_m, surface.sigma_m
        write_surface(folder, name, reference, SurfaceMap(*on_pixels))
    write(folder / SCORED, frame(SCORES, scores), SCORES)
    if MEASURED in references:
        write_json(folder / SIGMA, budget(surfaces[first][MEASURED]))


def depths_on_grid(references: Surfaces, grid: PixelGrid) -> dict[str, Reference]:
    """Compute the depths of every reference at the pixels of a grid, by casting rays: name →
    Reference."""
    surfaces = {
        name: reference_of_file(Path(mesh), transform, grid, exact=name == "truth")
        for name, (mesh, transform) in references.items()
        if name != "completed"
    }
    if "completed" in references:
        surfaces["completed"] = completed_by(surfaces[MEASURED], surfaces["truth"])
    return {name: surfaces[name] for name in references}


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
    velocities = velocity_errors(depth, error_m, reference)
    errors = ErrorMap(depth.x_m, depth.y_m, error_m, reference.z_m)
    return figures(errors, velocities, place="frames")


def _motion(depth: DepthMap, reference: Reference, times: Mapping[str, Any], frame: int) -> Values:
    """Return facts of the motion in a frame for the table of scores, as far as they are known: name
    → value. They are the start of the frame; and, if the surface moves or the map has velocities,
    the mean |radial velocity| of the surface, and the time from one tone to the next.
    times: content of the imaging stage's timing.json."""
    starts_s, speed_m_s = times.get("frame_times_s", []), mean_speed_m_s(reference)
    facts = {START: starts_s[frame]} if starts_s else {}
    if speed_m_s is not None and (speed_m_s > 0 or depth.velocity_m_s is not None):
        facts |= {SPEED: 1e3 * speed_m_s}
        facts |= {STEP: times["step_time_s"]} if "step_time_s" in times else {}
    return facts
