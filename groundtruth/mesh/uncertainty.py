"""Standard deviation of a photographed surface, from four independent causes whose variances add
up.

*Matching*: n views agree on a point, and their depths have a standard deviation s along the normal.
The n depths are not independent, since each depth map is matched between several images: two of the
n maps share an image so often that their errors are correlated by ρ = 1/(n − 1) (two maps of the
same pair of images are one measurement). So the spread s² is (1 − ρ) of one map's variance, and the
mean of the n maps has (1 + (n − 1) ρ)/n of it: var = 2 (n − 1)/(n (n − 2)) s². s is computed from
depths averaged over a few pixels (`fusion.Cloud.spread_m`), because a third of a map's variance
differs from pixel to pixel; most of the rest fades over a matching window, fastest on fine, strong
textures.

*Cameras*: the covariance of the cameras is propagated to the points (`point_covariance`).

*Extrapolation*: where the surface continues beyond the photographed points, its slope is known only
with the standard deviation SLOPE (1/4).

*Windows*: on curved or slanted surfaces, matching windows shift all depth maps equally, by a few
hundredths of a pixel (SHARED_PX). At the border of the visible surface, mostly a silhouette,
windows include the background, which shifts the surface by FATTENED_PX (a tenth of a pixel) at the
border, and by less up to a window's width inside. The spread between the views shows neither shift,
so both were measured.
"""

import numpy as np
from scipy.spatial import KDTree

from handbench.groundtruth.cameras import pycolmap
from handbench.groundtruth.dense.fusion import Cloud
from handbench.groundtruth.mesh.surface import mesh
from handbench.groundtruth.sparse.adjust import point_covariance

NEIGHBOURS = 16  # points whose variances a vertex takes the mean of
SAMPLED = 16  # of so many points, one is enough for the cameras' variance, which is smooth
SLOPE = 0.25  # standard deviation of the slope of unobserved surface
REACH_PX = 0.5  # of a point: half of the distance between neighbouring points
OBSERVED_PX = 1.5  # surface farther from every point counts as unobserved
FATTENED_PX, WINDOW_PX = 0.1, 3.0
SHARED_PX = 0.03  # hands' skin lies 0.04 px inside, fine strong textures 0.01 px
CHUNK = 1_000_000  # points times camera parameters that are worked on at once


def surface_sigma(
    cloud: Cloud, vertices_m: np.ndarray, images: "list[pycolmap.Image]", covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the standard deviation [n] along the normal, metres, of a surface's vertices [n, 3],
    and the mask [n] of observed vertices (those near points of the cloud).

    cloud: points that the surface was made from. images: the registered photographs; covariance
    [d, d]: of their cameras. Included are errors of matching, of the cameras, and of
    extrapolation away from the points, but not those of matching windows.
    """
    distances_m, near = KDTree(cloud.points_m).query(
        vertices_m, k=min(NEIGHBOURS, len(cloud.points_m))
    )
    nearest_m = distances_m[:, 0]
    beyond_m = np.maximum(nearest_m - REACH_PX * cloud.pixel_m, 0)
    some = cloud.at(slice(None, None, SAMPLED))
    of_cameras = camera_variance(some, images, covariance)
    variance = matching_variance(cloud)[near].mean(axis=1)
    variance += of_cameras[KDTree(some.points_m).query(vertices_m)[1]]
    return np.sqrt(variance + (SLOPE * beyond_m) ** 2), nearest_m <= OBSERVED_PX * cloud.pixel_m


def window_sigma(
    vertices_m: np.ndarray, faces: np.ndarray, observed: np.ndarray, pixel_m: float
) -> np.ndarray:
    """Compute the standard deviation [n], metres, that the size of matching windows causes at a
    surface's vertices [n, 3]. It is larger near the border of the observed surface.

    faces [m, 3]: triangles of vertex indices. observed [n]: mask of the observed vertices. pixel_m:
    size of a depth map's pixel on the surface.
    """
    seen = faces[observed[faces].all(axis=1)]
    edges = mesh(vertices_m, seen).get_non_manifold_edges(allow_boundary_edges=False)
    border = np.unique(edges).astype(int)
    shared = np.full(len(vertices_m), SHARED_PX)
    if len(border):
        distance_m, _ = KDTree(vertices_m[border]).query(vertices_m)
        shared = np.hypot(
            shared, FATTENED_PX * np.maximum(1 - distance_m / (WINDOW_PX * pixel_m), 0)
        )
    return shared * pixel_m


def matching_variance(cloud: Cloud) -> np.ndarray:
    """Compute the variance [n] (m²) that matching errors cause in a cloud's points along their
    normals. Each point is the mean over the views that agree on it; its variance follows from the
    number of these views and the spread of their depths."""
    n = cloud.views.sum(axis=1)
    by_many = n > 2
    spread_m = cloud.spread_m
    # two maps of one pair agree however wrong they are: they take the others' spread
    if by_many.any():
        spread_m = np.where(by_many, spread_m, np.sqrt(np.mean(spread_m[by_many] ** 2)))
    return np.where(by_many, 2 * (n - 1) / (n * np.maximum(n - 2, 1)), 2.0) * spread_m**2


def camera_variance(
    cloud: Cloud, images: "list[pycolmap.Image]", covariance: np.ndarray
) -> np.ndarray:
    """Compute the variance [n] (m²) that the uncertainty of the cameras causes in a cloud's points
    along their normals. images: the registered photographs; covariance [d, d]: of their cameras."""
    seen = np.zeros((len(cloud.views), len(images)), bool)
    for k, image in enumerate(images):
        if image.name in cloud.names:
            seen[:, k] = cloud.views[:, cloud.names.index(image.name)]
    variances = []
    size = max(1, CHUNK // len(covariance))
    for first in range(0, len(cloud.points_m), size):
        part = slice(first, first + size)
        of_points = point_covariance(images, covariance, cloud.points_m[part], seen[part])
        normals = cloud.normals[part]
        variances.append(np.einsum("na,nab,nb->n", normals, of_points, normals))
    return np.concatenate(variances)
