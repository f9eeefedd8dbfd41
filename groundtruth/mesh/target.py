"""Selection of the target among all surfaces in the photographs."""

from dataclasses import dataclass

import numpy as np

from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.volume import Plane
from handbench.support.errors import HandbenchError
from handbench.support.progress import say
from handbench.support.rays import TriangleMesh

OFF_PX = 6.0  # points nearer to the board's plane may belong to the board
RISES = 2.0  # a part lower than this many times that height is noise of the board
FEWEST_POINTS = 100  # least number of points above that height
SMALLEST_PART = 0.01  # of the largest part's triangles


@dataclass(frozen=True)
class TargetParts:
    """The connected parts of a surface that were kept and removed, as shares of its area: `parts`
    of each kept part, largest first; `dropped` of all removed ones together."""

    parts: tuple[float, ...]
    dropped: float


def remove_board(cloud: Cloud, plane: Plane) -> Cloud:
    """Return the cloud without the points on the board or behind its plane. Raises HandbenchError
    if too few points are clearly above the board."""
    height_m, least_m = plane.height_m(cloud.points_m), _least_m(plane, cloud.pixel_m)
    if (height_m > RISES * least_m).sum() < FEWEST_POINTS:
        raise _nothing_off(RISES * least_m)
    return cloud.at(height_m > least_m)


def keep_target(mesh: TriangleMesh, plane: Plane | None, pixel_m: float) -> TargetParts:
    """Remove unwanted connected parts from a surface, in place, and return a description of the
    rest.

    Tiny parts are removed. With a board's plane, parts are removed that nowhere rise to twice the
    height up to which a point may belong to the board. pixel_m: size of a depth map's pixel on the
    surface. Raises HandbenchError if no part rises so high.
    """
    label, triangles, area = (np.asarray(part) for part in mesh.cluster_connected_triangles())
    wanted = np.ones(len(triangles), dtype=bool)
    if plane is not None:
        rise_m = RISES * _least_m(plane, pixel_m)
        off = plane.height_m(np.asarray(mesh.vertices)) > rise_m
        wanted = np.isin(np.arange(len(wanted)), label[off[np.asarray(mesh.triangles)].any(axis=1)])
        if not wanted.any():
            raise _nothing_off(rise_m)
    wanted &= triangles >= triangles[wanted].max() * SMALLEST_PART
    mesh.remove_triangles_by_mask(~wanted[label])
    mesh.remove_unreferenced_vertices()
    shares = area / area.sum()
    target = TargetParts(
        tuple(sorted(shares[wanted].tolist(), reverse=True)), float(shares[~wanted].sum())
    )
    say(
        f"target: keeps {len(target.parts)} of {len(shares)} connected parts, with "
        f"{1 - target.dropped:.1%} of the surface"
    )
    return target


def _least_m(plane: Plane, pixel_m: float) -> float:
    """Return the height above the board's plane, metres, up to which a point may belong to it."""
    return max(plane.rough_m, OFF_PX * pixel_m)


def _nothing_off(height_m: float) -> HandbenchError:
    return HandbenchError(
        f"target: nothing rises more than {1e3 * height_m:.1f} mm above the board's plane; "
        "expected a target before or on the board; check --box and the photographs"
    )
