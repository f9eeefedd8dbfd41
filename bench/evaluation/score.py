"""The step from a depth map and a reference surface to errors and metrics, by which all commands
score."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handbench.bench.datasets.native import NativeCapture
from handbench.bench.evaluation.depth_errors import ErrorMap, error_map, velocity_errors
from handbench.bench.evaluation.metrics import Values, figures
from handbench.bench.evaluation.scoring_protocols import PAPER, Protocol
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import Reference, reference_on_grid
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError


@dataclass(frozen=True)
class Scores:
    """The scores of a depth map. errors: signed errors of its pixels; figures: metric → value in
    the metric's unit, None if it is undefined."""

    errors: ErrorMap
    figures: Values


def score(
    depth: DepthMap,
    reference: Reference,
    protocol: Protocol = PAPER,
    recorded: NativeCapture | None = None,
) -> Scores:
    """Compare a depth map with a reference on the same pixels: signed errors, and the metrics
    computed from them.

    protocol: which pixels are scored. recorded: the capture that was imaged, needed if the protocol
    applies the data set's own mask. Raises HandbenchError if that is missing, and for an invalid
    map.
    """
    z_m = scored_z_m(depth.checked("depth map"), protocol, recorded)
    errors = error_map(depth.x_m, depth.y_m, z_m, reference.z_m, reference.sigma_m, reference.met)
    velocities = velocity_errors(depth, errors.error_m, reference)
    return Scores(errors, figures(errors, velocities))


def scored_z_m(depth: DepthMap, protocol: Protocol, recorded: NativeCapture | None) -> np.ndarray:
    """Return the depths [ny, nx], metres, of the pixels that a protocol scores, and NaN elsewhere.
    Raises HandbenchError if the protocol applies the data set's mask and no capture is given."""
    if not protocol.masks:
        return depth.z_m
    if recorded is None:
        raise HandbenchError(
            f"protocol: '{protocol.id}' scores the pixels in the capture's own mask, but no "
            "capture is given; give one"
        )
    return np.where(recorded.mask(depth, protocol.erodes), depth.z_m, np.nan)


def reference_of_surface(
    surface: Surface, radar_from_mesh: Transform, grid: PixelGrid
) -> Reference:
    """Compute the depths of a surface, with their uncertainty, on a pixel grid of the radar, by
    casting rays: a `Reference`.

    radar_from_mesh: transform from the surface's frame to the radar frame. Raises HandbenchError if
    it leads to another frame.
    """
    radar_from_mesh.require(radar_from_mesh.source, "radar", "transform")
    return reference_on_grid(surface.moved(radar_from_mesh), grid.x_m, grid.y_m, radar_from_mesh)


def reference_of_file(
    mesh_file: Path, radar_from_mesh: Transform, grid: PixelGrid, exact: bool = False
) -> Reference:
    """Compute the depths of a mesh file's surface, with their uncertainty, on a pixel grid of the
    radar: a `Reference`.

    radar_from_mesh: transform from the mesh's frame to the radar frame. exact: True if surface and
    transform have no error, as in a simulation, whose surface is at rest if it has no velocities.
    """
    surface = read_surface(mesh_file)
    if exact:
        v_m_s, at_rest = surface.velocity_m_s, np.zeros(surface.vertices_m.shape)
        surface = replace(
            surface,
            sigma_m=np.zeros(len(surface.vertices_m)),
            velocity_m_s=at_rest if v_m_s is None else v_m_s,
        )
        radar_from_mesh = replace(radar_from_mesh, covariance=np.zeros((6, 6)))
    return reference_of_surface(surface, radar_from_mesh, grid)
