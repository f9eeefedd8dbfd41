"""Reconstruction of a surface from a cloud of points, and selection of the target among its parts.

Poisson reconstruction (Kazhdan & Hoppe, TOG 2013) closes holes; surface far from all points is
removed afterwards. Thresholds are in pixels of the depth maps.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.dense.volume import Plane
from handbench.support.errors import HandbenchError
from handbench.support.points import mean_by, voxels
from handbench.support.progress import say
from handbench.support.rays import TriangleMesh, load_open3d

VOXEL_PX = 1.0
NEIGHBOURS, OUTLIER_SIGMA = 20, 2.0
NORMAL_NEIGHBOURS = 24
FARTHEST_PX = 4.0  # between a vertex of the mesh and the nearest point
CELL_PX = 2.0  # of Poisson's octree
DEEPEST = 11  # of that octree; 2¹¹ cells a side
SMALLEST_CUBE = 1.1  # of that octree, relative to the points' box
FEWEST_POINTS = 500
OFF_PX = 6.0  # points nearer to the board's plane may belong to the board
RISES = 2.0  # a part lower than this many times that height is noise of the board
FEWEST_ABOVE = 100  # least number of points above that height
SMALLEST_PART = 0.01  # of the largest part's triangles


def clean(cloud: Cloud) -> Cloud:
    """Return the cloud with one mean point in each voxel (as large as a depth map's pixel), without
    outliers, and with normals estimated again from neighbouring points.

    The normals keep the side of the old ones, towards the cameras. Raises HandbenchError if the
    cloud has too few points.
    """
    o3d = load_open3d()
    if len(cloud.points_m) < FEWEST_POINTS:
        raise HandbenchError(
            f"dense reconstruction: the photographs agree on only {len(cloud.points_m)} points; "
            f"expected at least {FEWEST_POINTS}; take sharper photographs with more overlap, "
            "project a pattern of speckles, or check the crop box"
        )
    cloud = _one_per_voxel(cloud)
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points_m))
    _, kept = points.remove_statistical_outlier(NEIGHBOURS, OUTLIER_SIGMA)
    cloud = cloud.at(np.asarray(kept))
    points = points.select_by_index(kept)
    points.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBOURS))
    normals = np.array(points.normals)
    normals[(normals * cloud.normals).sum(axis=1) < 0] *= -1
    return replace(cloud, normals=normals)


def _one_per_voxel(cloud: Cloud) -> Cloud:
    """Replace the points in each voxel, which is as large as a depth map's pixel, by their mean.
    The mean point counts as confirmed by every view that confirmed one of these points."""
    voxel = voxels(cloud.points_m, VOXEL_PX * cloud.pixel_m)
    points_m, normals, views, squares_m2 = (
        mean_by(voxel, values)
        for values in (cloud.points_m, cloud.normals, cloud.views, cloud.spread_m**2)
    )
    return replace(
        cloud, points_m=points_m, normals=normals, views=views > 0, spread_m=np.sqrt(squares_m2)
    )


def surface(cloud: Cloud, box_m: np.ndarray | None = None) -> TriangleMesh:
    """Reconstruct the surface of a cloud as a triangle mesh, by Poisson's method.

    Surface that is far from all points or outside box_m [2, 3] is removed.
    """
    o3d = load_open3d()
    say(f"surface of {len(cloud.points_m)} points")
    points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points_m))
    points.normals = o3d.utility.Vector3dVector(cloud.normals)
    # the octree's cube, as a multiple of the points' box, gives cells of that size
    cells = np.ptp(cloud.points_m, axis=0).max() / (CELL_PX * cloud.pixel_m)
    depth = int(np.clip(np.ceil(np.log2(SMALLEST_CUBE * cells)), 6, DEEPEST))
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        points, depth=depth, scale=max(2**depth / cells, SMALLEST_CUBE), n_threads=1
    )
    distance_m, _ = KDTree(cloud.points_m).query(np.asarray(mesh.vertices))
    mesh.remove_vertices_by_mask(distance_m > FARTHEST_PX * cloud.pixel_m)
    if box_m is not None:
        mesh = mesh.crop(o3d.geometry.AxisAlignedBoundingBox(*box_m))
    return mesh


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
    if (height_m > RISES * least_m).sum() < FEWEST_ABOVE:
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
