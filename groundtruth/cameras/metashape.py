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

from collections.abc import Collection
from pathlib import Path, PurePosixPath, PureWindowsPath
from xml.etree import ElementTree

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, read_parsed
from handbench.support.limits import MOST_ELEMENTS, XML_BYTES

MOST_PARTS = 100  # of a sensor, and of its calibration
LARGEST = 1e12  # metres or pixels; nothing overflows
NOT_IN_COLMAP = ("k4", "p3", "p4")
SMALLEST_SKEW_PX = 0.05  # largest effect of B2 at the picture's edge that is ignored

Similarity = tuple[float, np.ndarray, np.ndarray]  # scale, rotation [3, 3], translation [3]


def read_metashape(path: str | Path, photos: Collection[str] | None = None) -> tuple[Camera, ...]:
    """Read cameras from Metashape's XML. Their names are Metashape's labels, which may lack the
    suffix of the photographs' file names.

    photos: names of the photographs; cameras of other pictures are skipped (None: all are read).
    Cameras that Metashape did not align have no pose; in a project without a scale, no camera has
    one. Raises HandbenchError for a lens that COLMAP cannot represent, and for a file that
    Metashape did not write.
    """
    root = read_parsed(path, "cameras exported by Metashape", "XML", _parse, XML_BYTES)
    chunks = [c for c in root.iterfind("chunk") if c.find("cameras//camera") is not None]
    if root.tag != "document" or len(chunks) != 1:
        raise HandbenchError(
            f"{path}: has {len(chunks)} Metashape chunks with cameras; expected exactly one; "
            "export the cameras of one chunk"
        )
    try:
        sensors = {_id(s, "id"): s for s in chunks[0].iterfind("sensors/sensor")}
        components = {
            _id(c, "id"): _similarity(c) for c in chunks[0].iterfind("components/component")
        }
        whole = _similarity(chunks[0])
        return tuple(
            _camera(camera, sensors, components.get(camera.get("component_id", "")) or whole)
            for camera in chunks[0].iterfind("cameras//camera")
            if photos is None or _is_of(_label(camera), photos)
        )
    except (ValueError, KeyError, TypeError) as error:
        raise HandbenchError(
            f"{path}: is not a cameras file of Metashape ({error}); export the cameras again"
        ) from error
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {error}") from error


def _label(element: ElementTree.Element) -> str:
    return PureWindowsPath(element.get("label", "")).name  # cuts at / and at \\


def _is_of(label: str, photos: Collection[str]) -> bool:
    """Tell whether a camera's label is the name of one of the photographs, with or without its
    suffix."""
    short = {one_form(label), one_form(PureWindowsPath(label).stem)}
    return any(name in short or PurePosixPath(name).stem in short for name in photos)


def _parse(text: str) -> ElementTree.Element:
    """Parse an XML text and return its root element.

    Raises ValueError for a text that is too large. A document type declaration is refused too,
    since its entities can expand to more memory than there is.
    """
    if "<!DOCTYPE" in text.upper():
        raise ValueError("it has a DOCTYPE")
    if text.count("<") + text.count("=") > MOST_ELEMENTS:
        raise ValueError(f"it has more than {MOST_ELEMENTS} tags and attributes")
    return ElementTree.fromstring(text)


def _camera(
    element: ElementTree.Element, sensors: dict[str, ElementTree.Element], world: Similarity | None
) -> Camera:
    label = _label(element)
    sensor = sensors[_id(element, "sensor_id")]
    width, height, params = _intrinsics(sensor, label)
    pose = {}
    if element.find("transform") is not None and world is not None:
        scale, rotation, translation_m = world
        matrix = _numbers(element, "transform", 16).reshape(4, 4)
        R = (rotation @ matrix[:3, :3]).T
        centre_m = scale * rotation @ matrix[:3, 3] + translation_m
        pose = {"R": tuple(map(tuple, R.tolist())), "t": tuple((-R @ centre_m).tolist())}
    return Camera(
        name=label, width=width, height=height, model="FULL_OPENCV", params=params, **pose
    )


def _intrinsics(sensor: ElementTree.Element, label: str) -> tuple[int, int, tuple[float, ...]]:
    """Read the intrinsics of a sensor (Metashape's word for a lens and its calibration).

    label: the camera's name, for messages. Returns width and height in pixels, and the 12
    parameters of COLMAP's lens model FULL_OPENCV. Raises HandbenchError for a lens that this model
    does not cover.
    """
    calibrations = {c.get("class", "adjusted"): c for c in sensor.iterfind("calibration")}
    calibration = calibrations.get("adjusted", calibrations.get("initial"))
    if calibration is None or {sensor.get("type", "frame"), calibration.get("type", "frame")} != {
        "frame"
    }:
        raise HandbenchError(
            f"camera {label}: has no calibration of type 'frame', the only one that handbench "
            "reads; calibrate it as a frame camera"
        )
    if max(len(sensor), len(calibration)) > MOST_PARTS:  # each camera goes through them
        raise ValueError(f"a sensor has more than {MOST_PARTS} parts")
    size = calibration.find("resolution")
    size = sensor.find("resolution") if size is None else size
    width, height = int(_id(size, "width")), int(_id(size, "height"))
    value = {
        child.tag: float(child.text or "") for child in calibration if child.tag != "resolution"
    }
    unknown = [name for name in NOT_IN_COLMAP if value.get(name, 0) != 0]
    skew_px = abs(value.get("b2", 0)) * height / 2 / value["f"] if value["f"] else np.inf
    if unknown or skew_px > SMALLEST_SKEW_PX:
        raise HandbenchError(
            f"camera {label}: has {' and '.join(unknown) or 'b2'}, for which COLMAP has no lens "
            "model; optimise the cameras in Metashape with f, cx, cy, k1, k2, k3, p1, p2 (and b1) "
            "only"
        )
    f, cx, cy, k1, k2, k3, p1, p2, b1 = (
        value.get(name, 0.0) for name in ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2", "b1")
    )
    return (
        width,
        height,
        (f + b1, f, width / 2 + cx, height / 2 + cy, k1, k2, p2, p1, k3, 0.0, 0.0, 0.0),
    )


def _similarity(element: ElementTree.Element) -> Similarity | None:
    """Read the scale, rotation [3, 3] and translation [3] that map the frame of a chunk or
    component to the world; None if the element has no scale."""
    if element.find("transform/scale") is None:
        return None
    scale = float(_numbers(element, "transform/scale", 1)[0])
    rotation = _numbers(element, "transform/rotation", 9).reshape(3, 3)
    return scale, rotation, _numbers(element, "transform/translation", 3)


def _numbers(element: ElementTree.Element, path: str, count: int) -> np.ndarray:
    """Read exactly `count` numbers from the text of the XML element at `path` below `element`.
    Raises ValueError if there are more or fewer, or if one is too large or not finite."""
    values = np.array([float(word) for word in (element.findtext(path) or "").split()])
    if len(values) != count or not (np.abs(values) < LARGEST).all():
        raise ValueError(
            f"{path} has {len(values)} numbers; expected {count} numbers below {LARGEST:g}"
        )
    return values


def _id(element: ElementTree.Element | None, name: str) -> str:
    """Return the attribute `name` of an XML element. Raises ValueError if the element or the
    attribute is missing."""
    value = None if element is None else element.get(name)
    if value is None:
        raise ValueError(f"the attribute {name} is missing")
    return value
