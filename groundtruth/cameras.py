"""Cameras with COLMAP's lens models and pixel convention (the first pixel's centre is at 0.5,
0.5)."""

import signal
import sys
from pathlib import Path
from threading import current_thread, main_thread
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, field_validator

from handbench.calibration.transforms import ROUNDING
from handbench.support.config import Config, FileName, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json


def load_pycolmap() -> ModuleType:
    """Import pycolmap, and undo that the import installs a SIGTERM handler of its own, which prints
    a stack trace. Only the main thread can do that; in a thread of a cluster's worker it stays."""
    first, before = "pycolmap" not in sys.modules, signal.getsignal(signal.SIGTERM)
    import pycolmap

    if first and before is not None and current_thread() is main_thread():
        signal.signal(signal.SIGTERM, before)
    return pycolmap


class _Colmap(ModuleType):
    """Stand-in for the module pycolmap, which is imported when an attribute is first used."""

    def __getattr__(self, name: str) -> object:
        return getattr(load_pycolmap(), name)


if TYPE_CHECKING:
    import pycolmap as pycolmap
else:
    pycolmap = _Colmap("pycolmap")


def cuda_devices() -> int:
    """Count the CUDA devices that pycolmap can use; 0 if pycolmap was built without CUDA."""
    return int(load_pycolmap().get_num_cuda_devices()) if pycolmap.has_cuda else 0


Row = tuple[float, float, float]


class Camera(Config):
    """The camera of one photograph: lens and, if known, pose.

    name: the photograph's. width, height: pixels. model, params: COLMAP's lens model and its
    parameters. `R` [3, 3] and `t` [3] (metres) map a world point X to the camera frame as R X + t
    (x right, y down, z forward); None if unknown.
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
            if not small or np.abs(R @ R.T - np.eye(3)).max() > ROUNDING or np.linalg.det(R) < 0:
                raise ValueError(
                    f"R is not a rotation matrix (3×3, orthonormal to {ROUNDING:g}, no reflection)"
                )
        return rows

    @property
    def posed(self) -> bool:
        """True if both rotation and translation of the camera are known."""
        return self.R is not None and self.t is not None

    @property
    def rotation(self) -> np.ndarray:
        """The rotation R from world to camera frame, as an array [3, 3]."""
        return np.array(self.R, np.float64)

    @property
    def translation_m(self) -> np.ndarray:
        """The translation t from world to camera frame, as an array [3], metres."""
        return np.array(self.t, np.float64)

    @property
    def centre_m(self) -> np.ndarray:
        """Projection centre [3] in the world frame, metres."""
        return -self.rotation.T @ self.translation_m

    def colmap(self) -> "pycolmap.Camera":
        """Convert the intrinsics to a pycolmap camera. Raises HandbenchError if COLMAP does not
        know the lens model, or if the model has another number of parameters."""
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
        """Project world points [n, 3] (metres) to pixels [n, 2], with lens distortion."""
        return np.asarray(
            self.colmap().img_from_cam(points_m @ self.rotation.T + self.translation_m)
        )


class CameraFile(Config):
    """The content of a `cameras.json` file."""

    cameras: tuple[Camera, ...] = Field(min_length=1)


def load_cameras(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras from a `cameras.json` file. Raises HandbenchError for a malformed file."""
    return parse(
        CameraFile, read_json(path, 'a cameras file {"cameras": [...]}'), str(path)
    ).cameras


def save_cameras(path: str | Path, cameras: tuple[Camera, ...]) -> None:
    """Write cameras to a `cameras.json` file, atomically."""
    write_json(path, {"cameras": [camera.model_dump(exclude_none=True) for camera in cameras]})


def registered_images(model: "pycolmap.Reconstruction") -> "list[pycolmap.Image]":
    """Return the images of a COLMAP model that have a pose, sorted by name."""
    return sorted(
        (image for image in model.images.values() if image.has_pose), key=lambda image: image.name
    )


def camera_in(image: "pycolmap.Image") -> "pycolmap.Camera":
    """Return the pycolmap camera of an image, which belongs to a COLMAP model."""
    assert image.camera is not None
    return image.camera


def set_pose(image: "pycolmap.Image", pose: "pycolmap.Rigid3d") -> None:
    """Set the pose (from world to camera) of an image, which belongs to a COLMAP model."""
    assert image.frame is not None
    image.frame.set_cam_from_world(image.camera_id, pose)
