"""Fusion of depth maps: points on which several views agree."""

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from handbench.groundtruth.dense.dense import ViewDepth
from handbench.groundtruth.dense.planesweep import LESS
from handbench.support.compiled import njit, prange
from handbench.support.cost import require_memory
from handbench.support.files import read_npz, write_npz
from handbench.support.limits import KEPT_BYTES

# other views that must agree; 1 where there are no more than a few views
CONFIRMATIONS, FEW_VIEWS = (2, 5)
AGREEMENT_PX = 1.7  # how far, in pixels times depth over focal length, two depths may be apart
WIDEST_COSINE = 0.5  # normals that agree
PIXEL_BYTES = 58  # a pixel of each depth map, and of two more for the one that is fused
AVERAGED_PX = 3  # a surface in cells of a pixel takes the mean of so many pixels by so many


@dataclass(frozen=True)
class Cloud:
    """Fused points [n, 3] and outward normals [n, 3] (not exactly of unit length) in the mesh's
    frame.

    views [n, number of views]: True where a view agrees on a point; names: the views' photographs.
    spread_m [n]: standard deviation, along the normal, between the depths of the agreeing views.
    Each view's depths are first averaged over a few neighbouring pixels, as a surface averages
    them, so that noise of single pixels does not count. pixel_m: median size of a depth map's pixel
    on the surface.
    """

    points_m: np.ndarray
    normals: np.ndarray
    views: np.ndarray
    spread_m: np.ndarray
    names: tuple[str, ...]
    pixel_m: float

    def at(self, index: np.ndarray) -> "Cloud":
        """Return the cloud with only the points that `index` selects, a mask [n] or indices."""
        per_point = ("points_m", "normals", "views", "spread_m")
        return replace(self, **{name: getattr(self, name)[index] for name in per_point})

    def save(self, file: Path) -> None:
        """Write the cloud to an .npz file."""
        write_npz(file, **asdict(self))

    @classmethod
    def load(cls, file: Path) -> "Cloud":
        """Read a cloud from the .npz file that `save` wrote."""
        found: dict[str, Any] = read_npz(
            file, tuple(field.name for field in fields(cls)), most=KEPT_BYTES
        )
        return cls(
            **{**found, "names": tuple(found["names"].tolist()), "pixel_m": float(found["pixel_m"])}
        )


def fuse(maps: list[ViewDepth], box_m: np.ndarray | None) -> Cloud:
    """Fuse depth maps to a cloud. Each pixel that enough other views confirm becomes the mean of
    the points of all views that agree.

    box_m [2, 3]: points outside are dropped (None: all are kept). Raises HandbenchError if memory
    does not suffice.
    """
    fewest = CONFIRMATIONS if len(maps) > FEW_VIEWS else 1
    shape = tuple(max(m.depth_m.shape[axis] for m in maps) for axis in (0, 1))
    needed = PIXEL_BYTES * (len(maps) + 2) * shape[0] * shape[1]
    require_memory(needed, f"dense: {len(maps)} depth maps of {shape[1]} × {shape[0]} pixels", LESS)
    depths = np.full((len(maps), *shape), np.nan)
    normals = np.zeros((len(maps), *shape, 3))
    for i, m in enumerate(maps):
        h, w = m.depth_m.shape
        depths[i, :h, :w], normals[i, :h, :w] = m.depth_m, m.normals
    K, R, t = (np.array([getattr(m.view, key) for m in maps]) for key in ("K", "R", "t"))
    parts = []
    for i in range(len(maps)):
        point, normal, agreeing, offset = _agree(i, depths, normals, K, R, t)
        kept = agreeing.sum(axis=-1) > fewest
        if box_m is not None:
            kept &= ((point >= box_m[0]) & (point <= box_m[1])).all(axis=-1)
        columns = point, normal, agreeing, _spread(offset, agreeing), depths[i] / K[i, 0, 0]
        parts.append([column[kept] for column in columns])
    points_m, normals, agreeing, spread_m, pixel_m = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    names = tuple(m.view.name for m in maps)
    return Cloud(
        points_m,
        normals,
        agreeing,
        spread_m,
        names,
        float(np.median(pixel_m)) if len(pixel_m) else np.nan,
    )


def _spread(offset: np.ndarray, agreeing: np.ndarray) -> np.ndarray:
    """Compute at each pixel the standard deviation [h, w], metres, between the depths of the views
    that agree on it.

    offset [h, w, views]: distance of each view's point from the pixel's own point, along the
    normal; averaged over a small window first. agreeing [h, w, views]: True for the views that
    agree.
    """
    size, near = (AVERAGED_PX, AVERAGED_PX), np.empty(offset.shape)
    for s in range(offset.shape[-1]):
        total, count = (
            cv2.blur(np.where(agreeing[..., s], a, 0), size) for a in (offset[..., s], np.ones(1))
        )
        near[..., s] = total / np.maximum(count, 0.5 / AVERAGED_PX**2)
    votes = agreeing.sum(axis=-1)
    near -= (np.where(agreeing, near, 0).sum(axis=-1) / np.maximum(votes, 1))[..., None]
    square = np.where(agreeing, near**2, 0).sum(axis=-1)
    return np.asarray(np.sqrt(square / np.maximum(votes - 1, 1)))


@njit(parallel=True, cache=True)
def _agree(
    reference: int,
    depths: np.ndarray,
    normals: np.ndarray,
    K: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Find the views that agree in depth and normal with each pixel of the view number `reference`.

    depths [views, h, w] (metres) and normals [views, h, w, 3]: depth maps of all views; K, R, t:
    their cameras. Returns for each pixel, over the reference and the agreeing views, the mean point
    [h, w, 3] and the mean normal [h, w, 3]; the mask [h, w, views] of these views; and the distance
    [h, w, views] of each view's point from the pixel's own, along the normal.
    """
    count, h, w = depths.shape
    point, normal = np.zeros((h, w, 3)), np.zeros((h, w, 3))
    agreeing = np.zeros((h, w, count), dtype=np.bool_)
    offset = np.zeros((h, w, count))
    for y in prange(h):
        here, seen, there = np.empty(3), np.empty(3), np.empty(3)
        for x in range(w):
            if np.isnan(depths[reference, y, x]):
                continue
            _world(x, y, depths[reference, y, x], K[reference], R[reference], t[reference], here)
            for axis in range(3):  # whole rows of three take seconds more to compile
                point[y, x, axis] += here[axis]
                normal[y, x, axis] += normals[reference, y, x, axis]
            agreeing[y, x, reference] = True
            votes = 1
            for s in range(count):
                _project(here, K[s], R[s], t[s], seen)
                j, i, depth = int(np.floor(seen[0] + 0.5)), int(np.floor(seen[1] + 0.5)), seen[2]
                if s == reference or depth <= 0 or not (0 <= i < h and 0 <= j < w):
                    continue
                if not abs(depths[s, i, j] - depth) * K[s, 0, 0] <= AGREEMENT_PX * depth:
                    continue
                cosine = 0.0
                for axis in range(3):
                    cosine += normals[s, i, j, axis] * normals[reference, y, x, axis]
                if cosine < WIDEST_COSINE:
                    continue
                _world(j, i, depths[s, i, j], K[s], R[s], t[s], there)
                for axis in range(3):
                    offset[y, x, s] += (there[axis] - here[axis]) * normals[reference, y, x, axis]
                    point[y, x, axis] += there[axis]
                    normal[y, x, axis] += normals[s, i, j, axis]
                agreeing[y, x, s] = True
                votes += 1
            for axis in range(3):
                point[y, x, axis] /= votes
                normal[y, x, axis] /= votes
    return point, normal, agreeing, offset


@njit(forceinline=True)
def _world(
    x: int, y: int, depth: float, K: np.ndarray, R: np.ndarray, t: np.ndarray, point: np.ndarray
) -> None:
    """Compute the world point that a view shows at pixel (x, y) and a given depth; written into
    `point` [3]."""
    a = (x - K[0, 2]) / K[0, 0] * depth - t[0]
    b = (y - K[1, 2]) / K[1, 1] * depth - t[1]
    c = depth - t[2]
    for axis in range(3):
        point[axis] = R[0, axis] * a + R[1, axis] * b + R[2, axis] * c


@njit(forceinline=True, error_model="numpy")  # a point in the camera's plane is seen at infinity
def _project(
    point: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, seen: np.ndarray
) -> None:
    """Project a world point [3] into a view; the column, row and depth are written into `seen`
    [3]."""
    a = R[0, 0] * point[0] + R[0, 1] * point[1] + R[0, 2] * point[2] + t[0]
    b = R[1, 0] * point[0] + R[1, 1] * point[1] + R[1, 2] * point[2] + t[1]
    c = R[2, 0] * point[0] + R[2, 1] * point[1] + R[2, 2] * point[2] + t[2]
    seen[0], seen[1], seen[2] = K[0, 0] * a / c + K[0, 2], K[1, 1] * b / c + K[1, 2], c
