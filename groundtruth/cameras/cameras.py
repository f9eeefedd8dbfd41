"""Cameras: COLMAP's models and pixel convention (the first pixel's centre is at 0.5, 0.5)."""

import signal
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, field_validator

from handbench.support.config import Config, FileName, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json


def load_pycolmap() -> ModuleType:
    """Import pycolmap without its SIGTERM handler, which prints a stack trace. Only the main thread
    can restore the old handler, so the first import must happen there."""
    first, before = "pycolmap" not in sys.modules, signal.getsignal(signal.SIGTERM)
    import pycolmap

    if first and before is not None:
        signal.signal(signal.SIGTERM, before)
    return pycolmap


class _Colmap(ModuleType):
    """pycolmap, imported on first use of an attribute."""

    def __getattr__(self, name: str) -> object:
        return getattr(load_pycolmap(), name)


if TYPE_CHECKING:
    import pycolmap as pycolmap
else:
    pycolmap = _Colmap("pycolmap")


def cuda_devices() -> int:
    """Number of CUDA devices that pycolmap can use; 0 where it was built without CUDA."""
    return int(load_pycolmap().get_num_cuda_devices()) if pycolmap.has_cuda else 0


Row = tuple[float, float, float]


class Camera(Config):
    """The camera of one photograph: lens and pose.

    model, params: COLMAP's lens model and its parameters. `R` [3, 3] and `t` [3] (metres) map world
    points to the camera frame (x right, y down, z forward); None where they are unknown.
    """

    name: FileName
    width: int = Field(gt=0, le=1_000_000)
    height: int = Field(gt=0, le=1_000_000)
    model: str = "OPENCV"
    params: tuple[float, ...]
    R: tuple[Row, ...] | None = None
    t: Row | None = None

    @field_validator("R")
    @classmethod
    def _is_rotation(cls, rows: tuple[Row, ...] | None) -> tuple[Row, ...] | None:
        if rows is not None:
            R = np.array(rows)
            small = R.shape == (3, 3) and np.abs(R).max() < 2  # larger numbers might overflow
            if not small or np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
                raise ValueError("R is not a rotation matrix (3×3, orthonormal, no reflection)")
        return rows

    @property
    def posed(self) -> bool:
        """True if its pose is known."""
        return self.R is not None and self.t is not None

    @property
    def rotation(self) -> np.ndarray:
        """R as an array [3, 3]."""
        return np.array(self.R, dtype=np.float64)

    @property
    def translation_m(self) -> np.ndarray:
        """t as an array [3], metres."""
        return np.array(self.t, dtype=np.float64)

    @property
    def centre_m(self) -> np.ndarray:
        """Projection centre [3] in the world frame, metres."""
        return -self.rotation.T @ self.translation_m

    def shifted(self, by_m: np.ndarray) -> "Camera":
        """Return the camera in a frame in which all positions are by_m [3] larger, metres."""
        if not self.posed or not by_m.any():
            return self
        return self.model_copy(
            update={"t": tuple((self.translation_m - self.rotation @ by_m).tolist())}
        )

    def colmap(self) -> "pycolmap.Camera":
        """Convert the intrinsics to a pycolmap camera. Raises HandbenchError for a model or
        parameters unknown to COLMAP."""
        try:
            camera = pycolmap.Camera(
                model=self.model, width=self.width, height=self.height, params=list(self.params)
            )
        except (ValueError, RuntimeError, KeyError):
            camera = None
        if camera is None or not camera.verify_params():
            raise HandbenchError(
                f"camera {self.name}: COLMAP has no model '{self.model}' with {len(self.params)} "
                "parameters; use one that it has, such as OPENCV with fx, fy, cx, cy, k1, k2, p1, "
                "p2"
            )
        return camera

    def project(self, points_m: np.ndarray) -> np.ndarray:
        """Project world points [n, 3] to pixels [n, 2], lens distortion included."""
        return np.asarray(
            self.colmap().img_from_cam(points_m @ self.rotation.T + self.translation_m)
        )

    def ray_directions(self, rows: slice = slice(None)) -> np.ndarray:
        """Compute the unit directions [rows, width, 3] in the world frame of the rays through all
        pixels' centres, with distortion undone. rows: only these rows of the picture."""
        u, v = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height)[rows] + 0.5)
        return self.directions(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(*u.shape, 3)

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Compute the unit directions [n, 3] in the world frame of the rays through pixels [n, 2],
        with distortion undone."""
        xy = np.asarray(self.colmap().cam_from_img(pixels))
        # of (x, y, 1), in place: there are millions
        rays = xy @ self.rotation[:2] + self.rotation[2]
        rays *= 1 / np.sqrt(1 + np.einsum("ij,ij->i", xy, xy))[:, None]
        return rays


class CameraFile(Config):
    """The content of `cameras.json`."""

    cameras: tuple[Camera, ...]

    @field_validator("cameras")
    @classmethod
    def _names_differ(cls, cameras: tuple[Camera, ...]) -> tuple[Camera, ...]:
        if len({camera.name for camera in cameras}) < len(cameras):
            raise ValueError("two cameras have the same name; rename one of them")
        return cameras


def load_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras in a `cameras.json`. Raises HandbenchError for a malformed file."""
    return parse(
        CameraFile, read_json(path, 'a cameras file {"cameras": [...]}'), str(path)
    ).cameras


def save_cameras(path: str | Path, cameras: tuple[Camera, ...]) -> None:
    """Write `cameras.json`, atomically."""
    write_json(path, {"cameras": [camera.model_dump(exclude_none=True) for camera in cameras]})


def registered_images(model: "pycolmap.Reconstruction") -> "list[pycolmap.Image]":
    """Return the images of a model that have a pose, sorted by name."""
    return sorted(
        (image for image in model.images.values() if image.has_pose), key=lambda image: image.name
    )


def camera_in(image: "pycolmap.Image") -> "pycolmap.Camera":
    """Return the camera that took a photograph of a model. Raises ValueError if the photograph is
    in no model."""
    if image.camera is None:
        raise ValueError(f"{image.name} is in no COLMAP model")
    return image.camera


def set_pose(image: "pycolmap.Image", pose: "pycolmap.Rigid3d") -> None:
    """Set the pose of a photograph in a model; pose: from world to camera. Raises ValueError if the
    photograph is in no model."""
    if image.frame is None:
        raise ValueError(f"{image.name} is in no COLMAP model")
    image.frame.set_cam_from_world(image.camera_id, pose)
