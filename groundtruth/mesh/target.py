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
    """The connected parts of a surface that were kept and removed.

    kept: which parts were kept, in words. on_board: share of the cloud's points that were removed
    with the board. parts: share of the whole surface's area of each kept part, largest first.
    dropped_parts, dropped: number of the removed parts, and their share of the area.
    """

    kept: str
    on_board: float
    parts: tuple[float, ...]
    dropped_parts: int
    dropped: float


def margin_m(plane: Plane, pixel_m: float) -> float:
    """Return the height above the board's plane, metres, up to which a point may belong to the
    board. pixel_m: size of a depth map's pixel on the surface."""
    return max(plane.rough_m, OFF_PX * pixel_m)


def remove_board(cloud: Cloud, plane: Plane) -> Cloud:
    """Return the cloud without the points on the board or behind its plane. Raises HandbenchError
    if too few points are clearly above the board."""
    height_m, least_m = plane.local(cloud.points_m)[:, 2], margin_m(plane, cloud.pixel_m)
    off = height_m > least_m
    if (height_m > RISES * least_m).sum() < FEWEST_POINTS:
        raise _nothing_off(RISES * least_m)
    if not off.all():
        say(
            f"target: {1 - off.mean():.1%} of the points are less than {1e3 * least_m:.1f} mm "
            "above the board, so they are left out"
        )
    return cloud.at(off)


def keep_target(mesh: TriangleMesh, plane: Plane | None, least_m: float) -> TargetParts:
    """Remove unwanted connected parts from a surface, in place, and return a description of the
    rest.

    Tiny parts are removed. With a board's plane, parts are removed that nowhere rise to twice the
    height least_m above it. Raises HandbenchError if no part rises so high.
    """
    label, triangles, area = (np.asarray(part) for part in mesh.cluster_connected_triangles())
    wanted, kept = np.ones(len(triangles), dtype=bool), "all parts"
    if plane is not None:
        kept = "what stands off the board"
        height_m = plane.local(np.asarray(mesh.vertices))[:, 2]
        highest_m = np.full(len(triangles), -np.inf)
        np.maximum.at(highest_m, label, height_m[np.asarray(mesh.triangles)].max(axis=1))
        wanted = highest_m > RISES * least_m
        if not wanted.any():
            raise _nothing_off(RISES * least_m)
    wanted &= triangles >= triangles[wanted].max() * SMALLEST_PART
    mesh.remove_triangles_by_mask(~wanted[label])
    mesh.remove_unreferenced_vertices()
    shares = area / area.sum()
    parts = tuple(sorted(shares[wanted].tolist(), reverse=True))
    target = TargetParts(kept, 0.0, parts, int((~wanted).sum()), float(shares[~wanted].sum()))
    listed = ", ".join(f"{share:.1%}" for share in target.parts)
    say(
        f"target: keeps {kept}: {len(target.parts)} of {len(shares)} connected parts, with "
        f"{listed} of the surface"
    )
    if target.dropped_parts:
        say(
            f"target: leaves out {target.dropped_parts} parts, with {target.dropped:.1%} of the "
            "surface"
        )
    return target


def _nothing_off(height_m: float) -> HandbenchError:
    return HandbenchError(
        f"target: nothing rises more than {1e3 * height_m:.1f} mm above the board's plane; "
        "expected a target before or on the board; check --box and the "
        "photographs"
    )
