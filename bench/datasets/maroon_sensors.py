"""MAROON's other sensors, Kinect, RealSense and ZED: depth cameras whose pictures count millimetres along their z.

Where what was read of their public code stands is told in docs/maroon.md. RealSense and ZED have pinholes; Kinect's
calibration.json is its factory's, of which the Azure Kinect SDK makes the cameras of its modes, its masks are pictures
of the colour camera, and so is its matrix's frame where `kinect_calib` does not say "depth".
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.maroon_alignment import Triangles, load_alignment, read_table
from handbench.calibration.transforms import checked_numbers
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.groundtruth.mesh.mesh_files import mesh
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError
from handbench.support.pictures import opened_picture

LENSES = {"kinect": "", "realsense": "rgb", "zed": "left"}  # sensor → its lens in calibration.json (Kinect: own form)
SIDES = {"zed": "left"}  # sensor → folder that its pictures lie deeper
LONGEST_MM = 10.0  # step in depth over which neighbours are joined (code/main.py: triangulation_threshold)
# Kinect's modes NFOV_UNBINNED and 1080P, which their code asks for: sides of the whole picture, corner and sides of it.
MODES = {"D0": ((1024, 1024), (192, 180), (640, 576)), "PV0": ((1920, 1440), (0, 180), (1920, 1080))}
LOCATION, MODEL = "CALIBRATION_CameraLocation", "CALIBRATION_LensDistortionModelBrownConrady"
BROWN_CONRADY = [0, 1, 2, 3, 4, 5, 13, 12, 6, 7, 8, 9]  # FULL_OPENCV's parameters among the factory's 14


def pictures(folder: Path, sensor: str, kind: str) -> list[Path]:
    """A sensor's pictures of a kind ("depth", "mask"), in order."""
    return sorted((folder / sensor / kind / SIDES.get(sensor, "")).glob("[0-9]*.png"))


@dataclass(frozen=True)
class OtherSensor:
    """A sensor of an object's folder; alignment: the file with its matrix; mirrored: tells later how to read it."""

    folder: Path
    name: str
    alignment: Path
    mirrored: Callable[[], bool]

    def __call__(self, grid: PixelGrid, frame: int = 0) -> np.ndarray:
        """Depth z [ny, nx] of what it saw, from the radar: `depth_on_grid` of its pixels joined to triangles."""
        points, faces = self.triangles(frame)
        transform = load_alignment(self.alignment, self.name, self.mirrored())
        return depth_on_grid(mesh(transform.points(points), faces), grid.x_m, grid.y_m)

    def triangles(self, frame: int = 0) -> Triangles:
        """A frame in its matrix's frame and unit, cut to the object where there is a mask. HandbenchError for a frame
        that is not there, and for files that are not the sensor's."""
        from handbench.groundtruth.photos.photos import read_gray

        depths, masks = (pictures(self.folder, self.name, kind) for kind in ("depth", "mask"))
        if not frame < len(depths):
            raise HandbenchError(f"{self.folder / self.name}: has {len(depths)} depth pictures, but no frame {frame}")
        counts, mask = _counts(depths[frame]), read_gray(masks[-1]) > 0 if masks else np.array(True)
        content = read_table(self.folder / self.name / "calibration.json", f"the cameras of MAROON's {self.name}")
        try:
            depth_mm = counts * 1e3 * _numbers(content.get("capture", {}).get("scale", 1e-3), 1)
            points_mm, seen = (self._kinect if self.name == "kinect" else self._pinhole)(depth_mm, mask, content)
        except (HandbenchError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise HandbenchError(f"{depths[frame].parent}: does not fit its calibration.json ({error})") from error
        scale = load_alignment(self.alignment, self.name).scale
        unit = {-3: 1.0, 0: 1e-3}.get(round(np.log10(scale)))
        if unit is None:
            raise HandbenchError(f"{self.alignment}: {self.name}2radar scales by {scale:.3g}; expected 0.001 or 1")
        return unit * points_mm, _joined(depth_mm, seen)

    def _pinhole(self, depth_mm: np.ndarray, mask: np.ndarray, content: Any) -> tuple[np.ndarray, np.ndarray]:
        """Points [n, 3] of the pixels [height, width] that are seen, and these."""
        lens, (height, width), seen = content[LENSES[self.name]], depth_mm.shape, (depth_mm > 0) & mask
        params = tuple(_numbers([lens[key] for key in ("fx", "fy", "cx", "cy")], 4) + [0, 0, 0.5, 0.5])
        camera = Camera(name=self.name, width=width, height=height, model="PINHOLE", params=params)
        return _points(camera, depth_mm, seen), seen

    def _kinect(self, depth_mm: np.ndarray, mask: np.ndarray, content: Any) -> tuple[np.ndarray, np.ndarray]:
        """The same, the mask being of the colour camera, in the frame of its matrix."""
        from scipy.ndimage import map_coordinates

        cameras = {c["Location"].removeprefix(LOCATION): c for c in content["CalibrationInformation"]["Cameras"]}
        depth, colour = (kinect_camera(cameras[place]) for place in MODES)
        rotation, shift_m = (_numbers(cameras["PV0"]["Rt"][key], n) for key, n in (("Rotation", 9), ("Translation", 3)))
        points_mm = _points(depth, depth_mm, seen := depth_mm > 0)
        of_colour_mm = points_mm @ rotation.reshape(3, 3).T + 1e3 * shift_m
        if mask.ndim:
            pixels = np.asarray(colour.colmap().img_from_cam(of_colour_mm)) - 0.5
            kept = map_coordinates(mask.astype(np.uint8), pixels.T[::-1], order=0) > 0
            points_mm, of_colour_mm, seen[seen] = points_mm[kept], of_colour_mm[kept], kept
        space = read_table(self.alignment).get("kinect_calib", {}).get("space", "color")
        return (points_mm if space == "depth" else of_colour_mm), seen


def kinect_camera(factory: dict[str, Any]) -> Camera:
    """The camera of a mode from the factory's entry for its sensor; ValueError for a lens of another model."""
    lens, place = factory["Intrinsics"], factory["Location"].removeprefix(LOCATION)
    (wide, high), (left, top), (width, height) = MODES[place]
    if lens["ModelType"] != MODEL:
        raise ValueError(f"the lens is {lens['ModelType']}, expected {MODEL}")
    cx, cy, fx, fy, *others = _numbers(lens["ModelParameters"], 14)
    params = np.array([fx * wide, fy * high, cx * wide - left, cy * high - top, *others])[BROWN_CONRADY]
    return Camera(name=place, width=width, height=height, model="FULL_OPENCV", params=tuple(params))


def _numbers(values: Any, count: int) -> np.ndarray:
    return checked_numbers("its", "numbers", np.reshape(values, -1).tolist(), [(count,)], 1e4)


def _points(camera: Camera, depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Points [n, 3] of the pixels that are seen, in the camera's frame."""
    if depth_mm.shape != (camera.height, camera.width):
        raise ValueError(f"a picture of {depth_mm.shape[::-1]} pixels, expected {(camera.width, camera.height)}")
    xy = np.asarray(camera.colmap().cam_from_img(np.argwhere(seen)[:, ::-1] + 0.5))
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1) * depth_mm[seen, None]


def _joined(depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Faces [m, 3] between neighbouring pixels whose depths differ by no more than LONGEST_MM."""
    index = np.where(seen, np.cumsum(seen).reshape(seen.shape) - 1, -1)
    corners = np.stack([index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [3, 2, 1]]])
    faces = faces[(faces >= 0).all(axis=1)]
    return faces[np.ptp(depth_mm[seen][faces], axis=1) <= LONGEST_MM]


def _counts(file: Path) -> np.ndarray:
    """A grey picture of 16 bits [height, width]."""
    with opened_picture(file) as image:
        if image.mode != "I;16":
            raise HandbenchError(f"{file}: has pixels of mode {image.mode}; expected grey ones of 16 bits")
        return np.asarray(image, np.float64)
