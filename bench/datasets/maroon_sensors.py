"""MAROON's other sensors, Kinect, RealSense and ZED: depth cameras whose pictures count millimetres along their z.

What their public code says (`code/maroon/sensors/*_data_loader.py`, `utils/data_utils.py`): depth/NNNNNN.png is uint16
and 0 where nothing was seen (ZED: depth/left/); mask/NNNNNN.png, that of the last frame, is nonzero on the object; the
first pixel's centre is at 0; RealSense's pictures are aligned to its colour camera and have no distortion, nor have
ZED's; neighbours whose depths differ by 10 mm are not joined. Kinect's calibration.json is its factory's, of which the
Azure Kinect SDK (MIT) makes the cameras of each mode: parameters in parts of the sensor's sides, an extract of the
sensor, Brown–Conrady lenses with six radial terms, colour from depth in metres. Its masks are pictures of the colour
camera, and so is the frame of its matrices where `kinect_calib` does not say "depth".
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.datasets.maroon_alignment import load_alignment, read_table
from calibration.transforms import checked_numbers
from groundtruth.cameras.cameras import Camera
from groundtruth.mesh.depth import depth_on_grid
from groundtruth.mesh.mesh_files import mesh
from radar.data.grid import PixelGrid
from radar.support.errors import HandbenchError
from radar.support.files import read_bytes
from radar.support.limits import PICTURE_BYTES

SENSORS = ("kinect", "realsense", "zed")
SIDE = {"zed": "left"}  # whose pictures lie a folder deeper
LENS = {"realsense": "rgb", "zed": "left"}  # of calibration.json
LONGEST_MM = 10.0  # step in depth over which neighbours are joined (code/main.py: triangulation_threshold)
UNITS = {1e-3: 1.0, 1.0: 1e-3}  # scale of a matrix into the radar's metres → what its points' millimetres are in it
# Mode of the Kinect: sides of the sensor's whole picture, corner and sides of the extract (the SDK's NFOV_UNBINNED and
# 1080P, which their code asks for; in its mode_specific_calibration.c).
MODES = {"D0": ((1024, 1024), (192, 180), (640, 576)), "PV0": ((1920, 1440), (0, 180), (1920, 1080))}
LOCATION, LENS_MODEL = "CALIBRATION_CameraLocation", "CALIBRATION_LensDistortionModelBrownConrady"
BROWN_CONRADY = [0, 1, 2, 3, 4, 5, 13, 12, 6, 7, 8, 9]  # FULL_OPENCV's parameters among the factory's 14


def sensors_of(folder: Path) -> tuple[str, ...]:
    """The other sensors that an object's folder holds."""
    return tuple(sensor for sensor in SENSORS if pictures(folder, sensor, "depth"))


def pictures(folder: Path, sensor: str, kind: str) -> list[Path]:
    """A sensor's pictures of a kind ("depth", "mask"), in order."""
    return sorted((folder / sensor / kind / SIDE.get(sensor, "")).glob("[0-9]*.png"))


@dataclass(frozen=True)
class OtherSensor:
    """A sensor of an object's folder; alignment: the file with its matrix; mirrored: says how to read that
    (`load_alignment`), when it is first needed."""

    folder: Path
    name: str
    alignment: Path
    mirrored: Callable[[], bool]

    def __call__(self, grid: PixelGrid, frame: int = 0) -> np.ndarray:
        """Depth z [ny, nx] of what it saw, from the radar: `depth_on_grid` of its pixels joined to triangles."""
        return depth_on_grid(mesh(*self.surface(frame, self.mirrored())), grid.x_m, grid.y_m)

    def surface(self, frame: int, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [n, 3] in the radar frame, metres, and faces [m, 3] of a frame, cut to the object where there is a
        mask. HandbenchError for a frame that is not there, and for files that are not the sensor's."""
        files = pictures(self.folder, self.name, "depth")
        if not frame < len(files):
            raise HandbenchError(
                f"{self.folder / self.name}: has {len(files)} depth pictures; frame {frame} is asked for"
            )
        depth_mm = _picture(files[frame], (np.uint16,)).astype(np.float64)
        content = read_table(self.folder / self.name / "calibration.json", f"the cameras of MAROON's {self.name}")
        masks = pictures(self.folder, self.name, "mask")
        mask = _picture(masks[-1], (np.uint8, np.uint16, bool)) > 0 if masks else None
        try:
            points_mm, seen = self._points_mm(depth_mm, content, mask)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise HandbenchError(f"{files[frame].parent}: does not fit its calibration.json ({error})") from error
        transform = load_alignment(self.alignment, self.name, mirrored)
        unit = next((unit for scale, unit in UNITS.items() if abs(abs(transform.scale) / scale - 1) < 0.1), None)
        if unit is None:
            raise HandbenchError(
                f"{self.alignment}: '{self.name}2radar' has a scale of {transform.scale:.3g}; expected 0.001 or 1, of "
                "millimetres or metres"
            )
        return transform.points(unit * points_mm), _joined(depth_mm, seen)

    def _points_mm(
        self, depth_mm: np.ndarray, content: dict[str, Any], mask: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points [n, 3] in the frame of the sensor's matrix of the pixels [height, width] that are seen."""
        seen = depth_mm > 0
        if self.name != "kinect":
            lens, unit = content[LENS[self.name]], float(content.get("capture", {}).get("scale", 1e-3)) / 1e-3
            seen = seen if mask is None else seen & mask
            params = tuple(float(lens[key]) + 0.5 * (key[0] == "c") for key in ("fx", "fy", "cx", "cy"))
            camera = Camera(name=self.name, width=seen.shape[1], height=seen.shape[0], model="PINHOLE", params=params)
            return unit * _points(camera, depth_mm, seen), seen
        of = {
            camera["Location"].removeprefix(LOCATION): camera for camera in content["CalibrationInformation"]["Cameras"]
        }
        depth, colour = (kinect_camera(of[place], place) for place in MODES)
        rotation, shift_m = (checked_numbers("calibration.json", key, of["PV0"]["Rt"][key], [(n,)])
                             for key, n in (("Rotation", 9), ("Translation", 3)))  # fmt: skip
        points_mm = _points(depth, depth_mm, seen)
        of_colour_mm = points_mm @ rotation.reshape(3, 3).T + 1e3 * shift_m
        if mask is not None:
            u, v = np.floor(np.asarray(colour.colmap().img_from_cam(of_colour_mm))).astype(int).T
            inside = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
            kept = inside & mask[v * inside, u * inside]
            points_mm, of_colour_mm, seen[seen] = points_mm[kept], of_colour_mm[kept], kept
        known = read_table(self.alignment).get("kinect_calib", {})
        return (points_mm if known.get("space", "color") == "depth" else of_colour_mm), seen


def kinect_camera(camera: dict[str, Any], place: str) -> Camera:
    """The camera of a mode from the factory's parameters; ValueError for a lens of another model."""
    lens = camera["Intrinsics"]
    if lens["ModelType"] != LENS_MODEL:
        raise ValueError(f"the lens is {lens['ModelType']}, expected {LENS_MODEL}")
    (wide, high), (left, top), (width, height) = MODES[place]
    cx, cy, fx, fy, *others = checked_numbers("calibration.json", "ModelParameters", lens["ModelParameters"], [(14,)])
    factory = np.array([fx * wide, fy * high, cx * wide - left, cy * high - top, *others])
    return Camera(name=place, width=width, height=height, model="FULL_OPENCV", params=tuple(factory[BROWN_CONRADY]))


def _points(camera: Camera, depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Points [n, 3] of the pixels that are seen, in the camera's frame; the unit is the depth's."""
    if depth_mm.shape != (camera.height, camera.width):
        raise ValueError(f"a picture of {depth_mm.shape[::-1]} pixels, expected {(camera.width, camera.height)}")
    v, u = np.nonzero(seen)
    xy = np.asarray(camera.colmap().cam_from_img(np.stack([u, v], axis=1) + 0.5))
    return np.concatenate([xy, np.ones((len(xy), 1))], axis=1) * depth_mm[seen, None]


def _joined(depth_mm: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Faces [m, 3] between neighbouring pixels whose depths differ by no more than LONGEST_MM."""
    index = np.where(seen, np.cumsum(seen).reshape(seen.shape) - 1, -1)
    corners = np.stack([index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [3, 2, 1]]])
    faces = faces[(faces >= 0).all(axis=1)]
    return faces[np.ptp(depth_mm[seen][faces], axis=1) <= LONGEST_MM]


def _picture(file: Path, kinds: tuple[type, ...]) -> np.ndarray:
    """A picture's first channel [height, width], of one of the kinds of number."""
    import cv2

    content = np.frombuffer(read_bytes(file, "a picture", PICTURE_BYTES), np.uint8)
    picture = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if picture is None or picture.dtype not in kinds:
        raise HandbenchError(
            f"{file}: is {None if picture is None else picture.dtype}; expected {kinds[0].__name__} (PNG)"
        )
    return picture if picture.ndim == 2 else picture[..., 0]
