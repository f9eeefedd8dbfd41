"""The target among what was photographed, and what is dropped for it, with its share."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.volume import Plane
from handbench.support.errors import HandbenchError
from handbench.support.progress import say
from handbench.support.rays import TriangleMesh

OFF_PX = 6.0  # a point nearer to the board's plane may be the board's
RISES = 2.0  # times as high: a part that stays lower is noise of the board
FEWEST_POINTS = 100  # that rise so high; fewer are noise
SMALLEST_PART = 0.01  # of the largest part's triangles

Components = Literal["target", "largest", "all"]


@dataclass(frozen=True)
class TargetParts:
    """The parts kept: in words; the share of the cloud's points that were dropped with the board's
    plane; the shares of the surface's area of the parts kept, largest first; the number of other
    parts, and their share."""

    kept: str
    on_board: float
    parts: tuple[float, ...]
    dropped_parts: int
    dropped: float


def margin_m(plane: Plane, pixel_m: float) -> float:
    """Height below which a point may be the board's."""
    return max(plane.rough_m, OFF_PX * pixel_m)


def remove_board(cloud: Cloud, plane: Plane) -> Cloud:
    """The cloud's points that stand off the board's plane on the cameras' side; a HandbenchError
    where there are none."""
    height_m, least_m = plane.local(cloud.points_m)[:, 2], margin_m(plane, cloud.pixel_m)
    off = height_m > least_m
    if (height_m > RISES * least_m).sum() < FEWEST_POINTS:
        raise _nothing_off(RISES * least_m)
    if not off.all():
        say(
            f"target: {1 - off.mean():.1%} of the points lie less than {1e3 * least_m:.1f} mm "
            "above the board: dropped"
        )
    return cloud.at(off)


def keep_target(
    mesh: TriangleMesh, components: Components, plane: Plane | None, least_m: float
) -> TargetParts:
    """Drop, in place, the parts of a surface that are not wanted, and those that are tiny against
    the largest; with the board's plane, those too that nowhere rise above it far beyond least_m."""
    label, triangles, area = (np.asarray(part) for part in mesh.cluster_connected_triangles())
    wanted, kept = (
        np.ones(len(triangles), dtype=bool),
        "the largest part" if components == "largest" else "all parts",
    )
    if plane is not None:
        kept = "what stands off the board"
        height_m = plane.local(np.asarray(mesh.vertices))[:, 2]
        highest_m = np.full(len(triangles), -np.inf)
        np.maximum.at(highest_m, label, height_m[np.asarray(mesh.triangles)].max(axis=1))
        wanted = highest_m > RISES * least_m
        if not wanted.any():
            raise _nothing_off(RISES * least_m)
    wanted &= triangles >= triangles[wanted].max() * (
        1 if components == "largest" else SMALLEST_PART
    )
    mesh.remove_triangles_by_mask(~wanted[label])
    mesh.remove_unreferenced_vertices()
    shares = area / area.sum()
    parts = tuple(sorted(shares[wanted].tolist(), reverse=True))
    target = TargetParts(kept, 0.0, parts, int((~wanted).sum()), float(shares[~wanted].sum()))
    listed = ", ".join(f"{share:.1%}" for share in target.parts)
    say(f"target: {kept}, {len(target.parts)} of {len(shares)} parts, with {listed} of the surface")
    if target.dropped_parts:
        say(
            f"target: {target.dropped_parts} parts dropped, with {target.dropped:.1%} of the "
            "surface"
        )
    return target


def _nothing_off(height_m: float) -> HandbenchError:
    return HandbenchError(
        f"target: nothing rises more than {1e3 * height_m:.1f} mm above the board's plane; "
        "expected a target before or "
        "on the board: check --box and the photographs, or give --components all for the board "
        "itself"
    )
