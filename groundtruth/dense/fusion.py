"""Fusion of depth maps: points on which several views agree."""

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from handbench.groundtruth.dense.dense import LOWEST_COSINE, ViewDepth
from handbench.support.files import KEPT_BYTES, read_npz, write_npz

AGREEING = 3  # views that must agree on a point
FEW_VIEWS = 5  # where no more views than these could see a point, two suffice
AGREEMENT_PX = 1.25  # how far, in pixels times depth over focal length, two depths may be apart
WIDEST_COSINE = 0.5  # normals that agree
AVERAGED_PX = 3  # a surface in cells of a pixel takes the mean of so many pixels by so many


@dataclass(frozen=True)
class Cloud:
    """Fused points [n, 3] and outward unit normals [n, 3] in the mesh's frame.

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

    def at(self, index: np.ndarray | slice) -> "Cloud":
        """Return the cloud with only the points that `index` selects: a mask [n], indices, or a
        slice."""
        per_point = ("points_m", "normals", "views", "spread_m")
        return replace(self, **{name: getattr(self, name)[index] for name in per_point})

    def save(self, file: Path) -> None:
        """Write the cloud to an .npz file."""
        write_npz(file, **asdict(self))

    @classmethod
    def load(cls, file: Path) -> "Cloud":
        """Read a cloud from the .npz file that `save` wrote."""
        columns: dict[str, Any] = read_npz(
            file, tuple(field.name for field in fields(cls)), most=KEPT_BYTES
        )
        columns["names"] = tuple(columns["names"].tolist())
        columns["pixel_m"] = float(columns["pixel_m"])
        return cls(**columns)


def fuse(maps: list[ViewDepth]) -> Cloud:
    """Fuse depth maps to a cloud. Each pixel becomes the weighted mean of the points of all views
    that agree on it, if these are three, or two where at most five views could see the point: of
    cameras all around an object, few see the same side."""
    shown_m = [(m.view.rays() * m.depth_m[..., None] - m.view.t) @ m.view.R for m in maps]
    parts = [_merge(i, maps, shown_m) for i in range(len(maps))]
    points_m, normals, views, spread_m, sizes_m = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    names = tuple(m.view.name for m in maps)
    pixel_m = float(np.median(sizes_m)) if len(sizes_m) else np.nan
    return Cloud(points_m, normals, views, spread_m, names, pixel_m)


def _merge(i: int, maps: list[ViewDepth], shown_m: list[np.ndarray]) -> list[np.ndarray]:
    """Merge the pixels of map number i with the pixels of all maps that agree, its own among them.

    shown_m: the points [h, w, 3] that each map shows. Returns, of the n pixels on which enough
    views agree, the mean points [n, 3], the map's normals [n, 3], the mask [n, maps] of the views
    that agree, the spread [n] of their depths, and the size [n] of a pixel on the surface, metres.
    """
    known = np.isfinite(maps[i].depth_m)
    own_m, normals = shown_m[i][known], maps[i].normals[known]
    shift_m = np.zeros_like(own_m)
    along_m, squares_m2, weights, viewers = np.zeros((4, len(own_m)))
    views = np.zeros((len(own_m), len(maps)), dtype=bool)
    for s, other in enumerate(maps):
        place, cosine, visible, agree = _compare(own_m, normals, other)
        viewers += visible
        views[:, s] = agree
        towards_m = np.where(agree[:, None], shown_m[s][place] - own_m, 0)
        weight = np.where(agree, cosine, 0).clip(0)  # oblique views match less well
        weights += weight
        shift_m += weight[:, None] * towards_m
        offset_m = _averaged(_dot(towards_m, normals), agree, known)
        along_m += offset_m
        squares_m2 += offset_m**2
    votes = views.sum(axis=1)
    spread_m2 = (squares_m2 - along_m**2 / votes) / np.maximum(votes - 1, 1)
    columns = (
        own_m + shift_m / weights[:, None],
        normals,
        views,
        np.sqrt(np.maximum(spread_m2, 0)),
        maps[i].depth_m[known] / maps[i].view.K[0, 0],
    )
    enough = votes >= np.where(viewers > FEW_VIEWS, AGREEING, 2)
    return [column[enough] for column in columns]


def _compare(
    points_m: np.ndarray, normals: np.ndarray, other: ViewDepth
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Compare points [n, 3] and their normals [n, 3] with a depth map.

    Returns the rows and columns [n] of the points' pixels; the cosine [n] of the angle between
    normal and line of sight; the mask [n] of the points that the view could see: they are in its
    picture, face it, and it shows nothing nearer; and the mask [n] of those that its depth and
    normal agree with.
    """
    view, (h, w) = other.view, other.depth_m.shape
    x, y, depth_m = view.K @ view.R @ points_m.T + (view.K @ view.t)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # points in the camera's plane
        column, row = np.rint(x / depth_m), np.rint(y / depth_m)
        inside = (depth_m > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
        place = np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)
        behind_px = (1 - other.depth_m[place] / depth_m) * view.K[0, 0]
    towards_m = view.centre_m - points_m
    cosine = _dot(towards_m, normals) / np.sqrt(_dot(towards_m, towards_m))
    visible = inside & (cosine > LOWEST_COSINE) & ~(behind_px > AGREEMENT_PX)
    agree = inside & (np.abs(behind_px) <= AGREEMENT_PX)
    agree &= _dot(other.normals[place], normals) >= WIDEST_COSINE
    return place, cosine, visible, agree


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("na,na->n", a, b))


def _averaged(values: np.ndarray, agree: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Average values [n] of the n True pixels of the mask `known` [h, w] over those of a few
    neighbouring pixels that agree [n]. Returns [n], 0 where a pixel does not agree itself."""
    sums, counts = np.zeros((2, *known.shape))
    sums[known], counts[known] = values * agree, agree
    sums, counts = (cv2.blur(p, (AVERAGED_PX, AVERAGED_PX)) for p in (sums, counts))
    return np.where(agree, sums[known] / np.maximum(counts[known], 1e-9), 0)
