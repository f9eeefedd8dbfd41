"""Views: photographs that are undistorted, cropped and shrunk for dense matching.

Depth is measured along the camera's z axis. PatchMatch uses inverse depth ω = 1/z:
on a plane in space, ω is exactly an affine function of the pixel, and a pixel x moves along a line
in a source view as ω changes: x_source ~ A x + b ω (Hartley & Zisserman, section 13.1).
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np

from handbench.groundtruth.cameras import pycolmap
from handbench.groundtruth.photos import Photo

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
        """Return the view at half the resolution. Each new pixel has the depth range of the first
        of the four pixels that it joins."""
        # index i of the half picture is centred at index 2 i + 1/2 of the whole one
        K = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]]) @ self.K
        gray = _shrunk(self.gray, 2)
        h, w = gray.shape
        near_m, far_m = (z[::2, ::2][:h, :w] for z in (self.near_m, self.far_m))
        return View(self.name, gray, K, self.R, self.t, near_m, far_m)

    def rays(self) -> np.ndarray:
        """Compute the viewing directions [h, w, 3] of the pixels in the camera frame, with z =
        1."""
        return _rays(self.K, *self.gray.shape)


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
        turns = [other.R @ view.R.T for other in others]
        A = np.stack([o.K @ R for o, R in zip(others, turns, strict=True)]) @ np.linalg.inv(view.K)
        b = np.stack([o.K @ (o.t - R @ view.t) for o, R in zip(others, turns, strict=True)])
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
    mask: np.ndarray,
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
    K[:2] /= shrink
    K[:2, 2] -= 0.5  # COLMAP's first pixel has its centre at 0.5
    gray = _shrunk(photo.gray(), shrink)
    size = gray.shape[::-1]
    low, high = np.array([(0, 0), size]) if box_m is None else _extent(box_m, K, R, t, size)
    width, height = (np.subtract(high, low) // 2 * 2).tolist()  # even, to be halved
    if min(width, height) < 4 * BORDER_PX:
        return None
    K[:2, 2] -= low
    rays = _rays(K, height, width)
    pixels = np.asarray(camera.img_from_cam(rays.reshape(-1, 3))) / shrink - 0.5
    columns, rows = pixels.T.reshape(2, height, width).astype(np.float32)
    gray = cv2.remap(gray, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    gray = cv2.GaussianBlur(gray, (0, 0), BLUR_PX)
    near_m, far_m = (np.full(gray.shape, depth_m) for depth_m in depth_range_m)
    if box_m is not None:
        # where each ray enters and leaves: the slab method
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings_m = (box_m[:, None, None] + R.T @ t) / (rays @ R)
        near_m, far_m = crossings_m.min(axis=0).max(axis=-1), crossings_m.max(axis=0).min(axis=-1)
        near_m = np.maximum(near_m, depth_range_m[0] / 4)  # for a camera inside the box
    shown = mask[shrink // 2 :: shrink, shrink // 2 :: shrink].astype(np.uint8)
    outside = (cv2.remap(shown, columns, rows, cv2.INTER_NEAREST) == 0) | ~(near_m < far_m)
    near_m[outside] = far_m[outside] = np.nan
    if outside.all():
        return None
    gray = gray.clip(0, 1)
    return View(photo.name, gray, K, R, t, near_m.astype(np.float32), far_m.astype(np.float32))


def _rays(K: np.ndarray, height: int, width: int) -> np.ndarray:
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)


def _shrunk(picture: np.ndarray, factor: int) -> np.ndarray:
    """Average squares of factor × factor pixels; incomplete ones at the end are dropped."""
    h, w = (n // factor for n in picture.shape)
    return cv2.resize(picture[: h * factor, : w * factor], (w, h), interpolation=cv2.INTER_AREA)


def _extent(
    box_m: np.ndarray, K: np.ndarray, R: np.ndarray, t: np.ndarray, size: tuple[int, ...]
) -> np.ndarray:
    """Find the part of a picture (size: width and height) that may show the box [2, 3].

    Returns the lowest and highest column and row [2, 2], with a border; the whole picture if a
    corner of the box is behind the camera.
    """
    corners_m = np.array(list(product(*box_m.T))) @ R.T + t
    if (corners_m[:, 2] <= 0).any():
        return np.array([(0, 0), size])
    pixels = corners_m @ K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    low, high = pixels.min(axis=0) - BORDER_PX, pixels.max(axis=0) + 1 + BORDER_PX
    return np.clip([low, high], 0, size).astype(int)
