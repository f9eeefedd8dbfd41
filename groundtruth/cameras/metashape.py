"""Reader of cameras that Metashape exported as XML (File > Export > Export Cameras; MAROON's
`cams.xml`).

Metashape's frame camera (user manual, appendix "Camera models") sees a point (X, Y, Z) of the
camera frame (x right, y down, z forward), with x = X / Z, y = Y / Z and r² = x² + y², at the pixel

    x' = x (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P1 (r² + 2 x²) + 2 P2 x y
    y' = y (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P2 (r² + 2 y²) + 2 P1 x y
    u = 0.5 w + cx + x' f + x' B1 + y' B2
    v = 0.5 h + cy + y' f

for a picture of w × h pixels whose first pixel has its centre at (0.5, 0.5), as in COLMAP. So cx
and cy count from the picture's middle, P1 and P2 are COLMAP's p2 and p1, f + B1 is the focal length
along x, and K3 needs COLMAP's lens model FULL_OPENCV.

A camera's `transform` (4 × 4, row by row) maps the camera frame to the frame of its chunk
(Metashape's word for a group of photographs) or of its component (a separately aligned part of a
chunk). The `transform` of the chunk or component maps that frame to the world by X ↦ scale ·
rotation · X + translation, in metres if the project has a scale.
"""

from collections import defaultdict
from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera
from handbench.support.errors import HandbenchError
from handbench.support.files import read_parsed
from handbench.support.limits import XML_BYTES

NOT_IN_COLMAP = ("k4", "p3", "p4")
SMALLEST_SKEW_PX = 0.05  # largest effect of B2 at the picture's edge that is ignored

Similarity = tuple[float, np.ndarray, np.ndarray]  # scale, rotation [3, 3], translation [3]


def read_metashape(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras from Metashape's XML. Their names are Metashape's labels, which may
    lack the suffix of the photographs' file names.

    Cameras that Metashape did not align have no pose; in a project without a scale, no camera has
    one. Raises HandbenchError for a lens that COLMAP cannot represent, and for a file that
    Metashape did not write.
    """
    root = read_parsed(
        path, "cameras exported by Metashape", "XML", ElementTree.fromstring, XML_BYTES
    )
    chunks = [c for c in root.iterfind("chunk") if c.find("cameras//camera") is not None]
    if len(chunks) != 1:
        raise HandbenchError(
            f"{path}: has {len(chunks)} Metashape chunks with cameras; expected exactly one; "
            "export the cameras of one chunk"
        )
    [chunk] = chunks
    sensors = {sensor.get("id"): sensor for sensor in chunk.iterfind("sensors/sensor")}
    parts = {part.get("id"): part for part in chunk.iterfind("components/component")}
    try:
        return tuple(
            _camera(
                camera,
                sensors[camera.get("sensor_id")],
                _world(parts.get(camera.get("component_id"), chunk)) or _world(chunk),
            )
            for camera in chunk.iterfind("cameras//camera")
        )
    except (ValueError, LookupError) as error:
        raise HandbenchError(
            f"{path}: is not a cameras file of Metashape ({error}); export the cameras again"
        ) from error
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {error}") from error


def _camera(
    element: ElementTree.Element, sensor: ElementTree.Element, world: Similarity | None
) -> Camera:
    """Read a camera. sensor: its lens with calibration; world: from its part's frame to the world,
    None if unknown."""
    name = PureWindowsPath(element.get("label", "")).name  # cuts at / and at \\
    width, height, params = _intrinsics(sensor, name)
    pose = {}
    if element.find("transform") is not None and world is not None:
        scale, rotation, translation_m = world
        matrix = _numbers(element, "transform", 16).reshape(4, 4)
        R = (rotation @ matrix[:3, :3]).T
        centre_m = scale * rotation @ matrix[:3, 3] + translation_m
        pose = {"R": tuple(map(tuple, R.tolist())), "t": tuple((-R @ centre_m).tolist())}
    return Camera(name=name, width=width, height=height, model="FULL_OPENCV", params=params, **pose)


def _intrinsics(sensor: ElementTree.Element, name: str) -> tuple[int, int, tuple[float, ...]]:
    """Read the intrinsics of a sensor (Metashape's word for a lens and its calibration).

    name: the camera's, for messages. Returns width and height in pixels, and the 12 parameters of
    COLMAP's lens model FULL_OPENCV. Raises HandbenchError for a lens that this model does not
    cover.
    """
    calibration = sensor.find("calibration[@class='adjusted']")
    if calibration is None:
        calibration = sensor.find("calibration")
    if calibration is None or sensor.get("type", "frame") != "frame":
        raise HandbenchError(f"camera {name}: is not calibrated as a frame camera; calibrate it so")
    size = [*calibration.iter("resolution"), *sensor.iter("resolution")][0].attrib
    width, height = int(size["width"]), int(size["height"])
    value = defaultdict[str, float](float)
    value |= {
        child.tag: float(child.text or "") for child in calibration if child.tag != "resolution"
    }
    skew = abs(value["b2"]) * height / 2
    if skew >= SMALLEST_SKEW_PX * value["f"] or any(value[term] for term in NOT_IN_COLMAP):
        raise HandbenchError(
            f"camera {name}: has b2, {' or '.join(NOT_IN_COLMAP)}, for which COLMAP has no lens "
            "model; optimise the cameras in Metashape with f, cx, cy, k1, k2, k3, p1, p2 (and b1) "
            "only"
        )
    fx, cx, cy = value["f"] + value["b1"], width / 2 + value["cx"], height / 2 + value["cy"]
    distortion = [value[term] for term in ("k1", "k2", "p2", "p1", "k3")]
    return width, height, (fx, value["f"], cx, cy, *distortion, 0.0, 0.0, 0.0)


def _world(element: ElementTree.Element) -> Similarity | None:
    """Read the scale, rotation [3, 3] and translation [3] that map the frame of a chunk or
    component to the world; None if the element has no scale."""
    if element.find("transform/scale") is None:
        return None
    rotation = _numbers(element, "transform/rotation", 9).reshape(3, 3)
    translation_m = _numbers(element, "transform/translation", 3)
    return _numbers(element, "transform/scale", 1).item(), rotation, translation_m


def _numbers(element: ElementTree.Element, path: str, count: int) -> np.ndarray:
    """Read `count` numbers from the text of the XML element at `path` below `element`."""
    values = np.array((element.findtext(path) or "").split(), np.float64)
    if len(values) != count:
        raise ValueError(f"{path} has {len(values)} numbers; expected {count}")
    return values
