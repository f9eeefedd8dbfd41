"""Views: photographs that are undistorted, cropped and shrunk for dense matching.

Depth is measured along the camera's z axis. Plane sweep and PatchMatch use inverse depth ω = 1/z:
on a plane in space, ω is exactly an affine function of the pixel, and a pixel x moves along a line
in a source view as ω changes: x_source ~ A x + b ω (Hartley & Zisserman, section 13.1).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from handbench.groundtruth.cameras.cameras import pycolmap
from handbench.groundtruth.photos.photos import Photo

# kept around the region of interest, so that a matching window never leaves the picture
BORDER_PX = 8
# standard deviation of the blur of every picture. Interpolation averages the noise of neighbouring
# pixels, so that without blur noise matches best half-way between pixels.
BLUR_PX = 0.5


@dataclass(frozen=True)
class View:
    """A photograph prepared for matching: gray values of the region of interest, undistorted, with
    its pinhole camera.

    gray [h, w] float32. K [3, 3] maps camera coordinates to array indices (column, row), where the
    first pixel's centre is at 0. R [3, 3] and t [3] (metres) map a world point X to the camera
    frame as R X + t. near_m, far_m [h, w] float32: smallest and largest depth that the surface may
    have at a pixel, NaN for pixels that are not of interest.
    """

    name: str
    gray: np.ndarray
    K: np.ndarray
    R: np.ndarray
    t: np.ndarray
    near_m: np.ndarray
    far_m: np.ndarray

    @cached_property
    def centre_m(self) -> np.ndarray:
        """Projection centre [3] in the world frame, metres."""
        return -self.R.T @ self.t

    def halved(self) -> "View":
        """Return the view at half the resolution. The depth range of each new pixel covers the
        ranges of the four pixels that it joins."""
        with np.errstate(invalid="ignore"):
            near, far = (_blocks(depth, 2).min((1, 3)) for depth in (self.near_m, -self.far_m))
        K = self.K / 2
        # index i of the half picture is centred at index 2 i + 1/2 of the whole one
        K[:2, 2] -= 0.25
        K[2, 2] = 1
        return View(self.name, _shrink(self.gray, 2), K, self.R, self.t, near, -far)

    def rays(self) -> np.ndarray:
        """Compute the viewing directions [h, w, 3] of the pixels in the camera frame, with z =
        1."""
        return _rays(self.K, *self.gray.shape)

    def to(self, source: "View") -> tuple[np.ndarray, np.ndarray]:
        """Compute the map from this view to another: pixel x = [column, row, 1] at inverse depth ω
        (1/m) appears in `source` at A x + b ω, in homogeneous coordinates. Returns A [3, 3] and b
        [3]."""
        R = source.R @ self.R.T
        return source.K @ R @ np.linalg.inv(self.K), source.K @ (source.t - R @ self.t)


class Stereo(NamedTuple):
    """A reference picture [h, w] and the pictures [s, H, W] of the s source views that it is
    matched with, float32, as plain arrays for compiled functions.

    sizes [s, 2]: rows and columns of each source view; the rest of its picture is padded with 0. A
    pixel x = [column, row, 1] at disparity δ appears in source view number i at A[i] x + b[i] δ, in
    homogeneous coordinates. unit: inverse depth (1/m) of one step of disparity.
    """

    reference: np.ndarray
    sources: np.ndarray
    sizes: np.ndarray
    A: np.ndarray
    b: np.ndarray
    unit: float

    @classmethod
    def of(cls, view: View, others: list[View]) -> "Stereo":
        """Combine a view and its source views for matching. The unit of disparity is chosen so that
        one step moves a pixel by about one pixel in the source where it moves most."""
        sizes = np.array([other.gray.shape for other in others])
        sources = np.zeros((len(others), *sizes.max(axis=0)), dtype=np.float32)
        for padded, other in zip(sources, others, strict=True):
            padded[: other.gray.shape[0], : other.gray.shape[1]] = other.gray
        A, b = (
            np.stack(parts) for parts in zip(*(view.to(other) for other in others), strict=True)
        )
        h, w = view.gray.shape
        # in the middle of view and depths
        q = A @ [w / 2, h / 2, 1] + b * np.nanmean(2 / (view.near_m + view.far_m))
        unit = 1 / float(
            np.linalg.norm((b[:, :2] - b[:, 2:] * q[:, :2] / q[:, 2:]) / q[:, 2:], axis=1).max()
        )
        return cls(view.gray, sources, sizes, A, b * unit, unit)


def open_view(
    photo: Photo,
    camera: "pycolmap.Camera",
    pose: "pycolmap.Rigid3d",
    shrink: int,
    depth_range_m: tuple[float, float],
    box_m: np.ndarray | None,
    mask: np.ndarray | None = None,
) -> View | None:
    """Read a photograph, shrink it by the whole number `shrink`, and undo its lens distortion.

    camera, pose: the photograph's; pose maps world to camera. depth_range_m: smallest and largest
    depth of the surface. box_m [2, 3]: lowest and highest corner of the region of interest in the
    world frame; the picture is cropped to it, and depths are limited to it. mask [height, width]:
    True at the photograph's pixels that are of interest. Returns None if the picture shows nothing
    of interest.
    """
    R, t = pose.rotation.matrix(), pose.translation
    K = camera.calibration_matrix()
    K[0, 1] = 0
    K[:2] /= shrink
    width, height = camera.width // shrink, camera.height // shrink
    left, top, right, bottom = (
        (0, 0, width, height) if box_m is None else _extent(box_m, K, R, t, width, height)
    )
    right, bottom = right - (right - left) % 2, bottom - (bottom - top) % 2
    if right - left < 4 * BORDER_PX or bottom - top < 4 * BORDER_PX:
        return None
    K[:2, 2] -= (left + 0.5, top + 0.5)  # COLMAP's corner origin to indices of the crop
    rays = _rays(K, bottom - top, right - left)
    seen = (
        np.asarray(camera.img_from_cam(rays.reshape(-1, 3))).reshape(*rays.shape[:2], 2) / shrink
        - 0.5
    )
    columns, rows = np.moveaxis(seen.astype(np.float32), -1, 0)
    shrunk = _shrink(photo.gray(), shrink)
    gray = cv2.remap(shrunk, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    gray = cv2.GaussianBlur(gray, (0, 0), BLUR_PX)
    near, far = (np.full(gray.shape, z) for z in depth_range_m)
    if box_m is not None:
        # where each ray enters and leaves: the slab method
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings = (box_m[:, None, None] + R.T @ t) / (rays @ R)
        near, far = crossings.min(axis=0).max(axis=-1), crossings.max(axis=0).min(axis=-1)
        near = np.maximum(near, depth_range_m[0] / 4)  # for a camera inside the box
    outside = ((seen < 0) | (seen > (width - 1, height - 1))).any(axis=2) | ~(near < far)
    if mask is not None:
        # beyond its edges: what is there
        column, row = np.moveaxis(np.floor((seen + 0.5) * shrink).astype(int), -1, 0)
        outside |= ~mask[row.clip(0, mask.shape[0] - 1), column.clip(0, mask.shape[1] - 1)]
    near[outside] = far[outside] = np.nan
    if outside.all():
        return None
    return View(
        photo.name, np.clip(gray, 0, 1), K, R, t, near.astype(np.float32), far.astype(np.float32)
    )


def _rays(K: np.ndarray, height: int, width: int) -> np.ndarray:
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)


def _blocks(picture: np.ndarray, factor: int) -> np.ndarray:
    """Split a picture [h, w] into squares of factor × factor pixels: [h / factor, factor, w /
    factor, factor], where axes 1 and 3 count within a square. Incomplete squares at the end are
    dropped."""
    h, w = (n // factor for n in picture.shape)
    return picture[: h * factor, : w * factor].reshape(h, factor, w, factor)


def _shrink(picture: np.ndarray, factor: int) -> np.ndarray:
    return picture if factor == 1 else _blocks(picture, factor).mean((1, 3), dtype=np.float32)


def _extent(
    box_m: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, width: int, height: int
) -> tuple[int, int, int, int]:
    """Find the part of a picture of width × height pixels that may show the box [2, 3].

    Returns left, top, right and bottom in pixels, with a border; the whole picture if a corner of
    the box is behind the camera.
    """
    corners = np.stack(np.meshgrid(*box_m.T), axis=-1).reshape(-1, 3) @ R.T + t
    if (corners[:, 2] <= 0).any():  # a corner is behind the camera
        return (0, 0, width, height)
    pixels = corners @ K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    low = np.maximum(np.floor(pixels.min(axis=0)) - BORDER_PX, 0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + BORDER_PX, (width, height)).astype(int)
    return (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
