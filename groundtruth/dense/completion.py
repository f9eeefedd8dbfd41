"""Repeated matching of every view, starting from the depths of all views.

The first search may miss a thin object in one view and find it in another. So the fused points of
all views are rendered into each view as initial depths of PatchMatch, and all pixels are matched
and filtered again.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt

from handbench.groundtruth.dense.dense import ITERATIONS, LOOKS, THOROUGH, ViewDepth, refine_planes
from handbench.groundtruth.dense.first_guess import planes_through
from handbench.groundtruth.dense.fusion import Cloud, fuse
from handbench.groundtruth.dense.views import Stereo, View
from handbench.support.progress import track

CONFIRMATIONS = 1  # other views that must confirm a point; wrong points do not match again
STEEPEST = 8.0  # disparities per pixel


def complete_maps(maps: list[ViewDepth], sources: list[list[int]], seed: int) -> list[ViewDepth]:
    """Compute all depth maps again, twice (LOOKS), each starting from its own depths and, where
    these are missing, from the other views' depths.

    sources: for each view, the indices of the views that it is matched with. seed: of PatchMatch's
    random numbers. Returns the new depth maps, in the order of the old ones.
    """
    for _ in range(LOOKS):
        cloud, again = fuse(maps, None, CONFIRMATIONS), []
        for m, used in zip(track(maps, "another look"), sources, strict=True):
            stereo = Stereo.of(m.view, [maps[s].view for s in used])
            depth_m, normals = render_cloud(cloud, m.view)
            known = np.isfinite(m.depth_m)
            depth_m, normals = (
                np.where(known, m.depth_m, depth_m),
                np.where(known[..., None], m.normals, normals),
            )
            planes = _filled(
                planes_through(m.view, depth_m, normals @ m.view.R.T, stereo.unit, STEEPEST)
            )
            again.append(refine_planes(m.view, stereo, planes, ITERATIONS, seed, THOROUGH))
        maps = again
    return maps


def render_cloud(cloud: Cloud, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Render a cloud into a view. Returns depth [h, w] in metres (NaN: no point) and unit normal
    [h, w, 3] in the cloud's frame, both of the nearest point that faces the view at each pixel."""
    h, w = view.gray.shape
    depth_m, normals = np.full((h, w), np.nan), np.zeros((h, w, 3))
    local = cloud.points_m @ view.R.T + view.t
    faces = (((cloud.points_m - view.centre_m) * cloud.normals).sum(axis=1) < 0) & (local[:, 2] > 0)
    # the nearest is written last
    order = np.flatnonzero(faces)[np.argsort(-local[faces, 2], kind="stable")]
    pixels = local[order] @ view.K.T
    column, row = np.floor(pixels[:, :2] / pixels[:, 2:] + 0.5).T
    shown = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    order, place = order[shown], (row[shown].astype(int), column[shown].astype(int))
    depth_m[place], normals[place] = local[order, 2], cloud.normals[order]
    return depth_m, normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)


def _filled(planes: np.ndarray) -> np.ndarray:
    """Return a map of planes [h, w, 3] (disparity and its slopes per column and row) in which each
    missing plane (NaN) is replaced by that of the nearest pixel with one. A map without any plane
    is returned unchanged."""
    missing = np.isnan(planes[..., 0])
    if missing.all():
        return planes
    row, column = distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.ascontiguousarray(planes[row, column])
