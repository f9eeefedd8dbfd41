"""Readers of known cameras: handbench's cameras.json, COLMAP models and Metashape's XML (File >
Export > Export Cameras; MAROON's `cams.xml`).

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

import os
import posixpath
from collections import defaultdict
from collections.abc import Sequence
from math import prod
from pathlib import Path, PureWindowsPath
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import numpy as np

from handbench.groundtruth.cameras import (
    Camera,
    camera_in,
    load_cameras,
    pycolmap,
    registered_images,
)
from handbench.groundtruth.photos import FEWEST, Photo
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    MODEL_BYTES,
    XML_BYTES,
    one_form,
    read_bytes,
    read_parsed,
    require_folder,
)
from handbench.support.progress import say

# least and largest focal length over the picture's longer side, largest distortion
PLAUSIBLE = (0.1, 20.0, 100.0)
NOT_IN_COLMAP = ("k4", "p3", "p4")
# of a record in a file of a COLMAP model: bytes before the number of its entries (in images, also
# of a name), of this number, and of an entry
RECORDS = {"images.bin": (64, 8, 24), "frames.bin": (64, 4, 16), "points3D.bin": (43, 8, 8)}
SMALLEST_SKEW_PX = 0.05  # largest effect of B2 at the picture's edge that is ignored


def cameras_of(photos: Sequence[Photo | Camera], path: Path) -> tuple[Camera, ...]:
    """Read the camera of each photograph from a cameras.json, a COLMAP model's folder or
    Metashape's XML.

    Returns the cameras in the photographs' order. A photograph that a COLMAP model lacks has none,
    which is reported. Raises HandbenchError if another file has no camera for a photograph, if
    fewer than three remain, and for a camera of another picture size or with implausible values.
    """
    if path.is_dir():
        read = cameras_in(read_model(path))
    else:
        read = (read_metashape if path.suffix.lower() == ".xml" else load_cameras)(path)
    cameras = []
    for photo in photos:
        camera = _of_photo(photo.name, read, path)
        if camera is None:
            missing = f"{path}: has no camera for the photograph {photo.name}"
            if not path.is_dir():
                raise HandbenchError(f"{missing}; add one, or remove the photograph")
            say(f"{missing}, which is left out")
            continue
        if (camera.width, camera.height) != (photo.width, photo.height):
            raise HandbenchError(
                f"{path}: the camera of {photo.name} is for {camera.width} × {camera.height} "
                f"pixels, but the photograph has {photo.width} × {photo.height}; use cameras made "
                "from exactly these files"
            )
        if camera.colmap().has_bogus_params(*PLAUSIBLE):
            raise HandbenchError(
                f"{path}: the lens of {camera.name} has impossible values; expected a focal length "
                "of 0.1 to 20 picture sides, and the principal point in the picture"
            )
        cameras.append(camera.model_copy(update={"name": photo.name}))
    if path.is_dir() and len(cameras) < FEWEST:
        raise HandbenchError(
            f"{path}: has cameras for {len(cameras)} of the {len(photos)} photographs; expected "
            f"at least {FEWEST}, with the same file names"
        )
    return tuple(cameras)


def read_model(folder: Path) -> "pycolmap.Reconstruction":
    """Read a COLMAP model (text or binary) from a folder. Raises HandbenchError if a file is
    broken."""
    require_folder(folder, "a COLMAP model (cameras, images and points3D, .bin or .txt)")
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    try:
        _require_whole(folder)
        model = pycolmap.Reconstruction(str(folder))
        names = _names_in_text(folder)
        for number, image in model.images.items():
            image.name = one_form(names.get(number) or image.name)
    except (ValueError, IndexError, RuntimeError, MemoryError, OverflowError) as error:
        raise HandbenchError(
            f"{folder}: is not readable as a COLMAP model ({str(error)[:200]}); expected "
            "cameras, images and points3D, .bin or .txt"
        ) from error
    finally:
        pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    return model


def _names_in_text(folder: Path) -> dict[int, str]:
    """Read the names of a COLMAP model's images, by the images' numbers, from its images.txt, of
    which COLMAP cuts them at the first space. Empty for a binary model."""
    names: dict[int, str] = {}
    if (folder / "images.bin").is_file():
        return names
    content = read_bytes(folder / "images.txt", "the images of a COLMAP model", MODEL_BYTES)
    lines = map(bytes.strip, content.splitlines())
    for line in lines:
        if line and not line.startswith(b"#"):
            number, *_, name = line.split(maxsplit=9)
            names[int(number)] = os.fsdecode(name)
            next(lines, None)  # the image's points
    return names


def cameras_in(model: "pycolmap.Reconstruction") -> tuple[Camera, ...]:
    """Return the cameras, with lens and pose, of all images of a model that have a pose, sorted by
    name. Raises HandbenchError for impossible values."""
    cameras = []
    for image in registered_images(model):
        camera, pose = camera_in(image), image.cam_from_world()
        values = {
            "name": image.name,
            "width": camera.width,
            "height": camera.height,
            "model": camera.model_name,
            "params": camera.params.tolist(),
            "R": pose.rotation.matrix().tolist(),
            "t": pose.translation.tolist(),
        }
        cameras.append(parse(Camera, values, f"COLMAP's camera of {image.name}"))
    return tuple(cameras)


def _of_photo(name: str, cameras: tuple[Camera, ...], where: Path) -> Camera | None:
    """Return the camera of a photograph by its name; None if there is none.

    Names are compared whole, then without folders, then also without suffix. where: the file that
    the cameras are from, for messages. Raises HandbenchError if two names match.
    """
    for cut in (str, posixpath.basename, lambda path: Path(path).stem):
        same = [one for one in cameras if cut(one.name) == cut(name)]
        if len(same) > 1:
            raise HandbenchError(
                f"{where}: {' and '.join(one.name for one in same)} may both be the photograph "
                f"{name}; rename one of them"
            )
        if same:
            return same[0]
    return None


def write_model(model: "pycolmap.Reconstruction", folder: Path) -> None:
    """Write a COLMAP model into a folder, in binary form. Raises HandbenchError if a file is
    incomplete, as on a full disk, which COLMAP itself does not report."""
    model.write_binary(folder)
    _require_whole(folder)


def _require_whole(folder: Path) -> None:
    """Raise HandbenchError if the length of a binary file of a COLMAP model does not agree with the
    counts in it, which COLMAP's reader trusts: of a file that is cut, it may never return."""
    for name, (head, number, entry) in RECORDS.items():
        file = folder / name
        if not file.is_file():
            continue
        content = read_bytes(file, "a part of a COLMAP model", MODEL_BYTES)
        end = 8
        records = 0
        while end < len(content):
            end += head
            if name == "images.bin":
                end = content.find(b"\0", end) + 1 or len(content) + 1  # of the image's name
            end += number + entry * int.from_bytes(content[end : end + number], "little")
            records += 1
        if (end, records) != (len(content), int.from_bytes(content[:8], "little")):
            raise HandbenchError(
                f"{file}: has {len(content)} bytes, which is not the length of its contents; copy "
                "it again, or free space on the disk"
            )


def read_metashape(path: str | Path) -> tuple[Camera, ...]:
    """Read the cameras from Metashape's XML. Their names are Metashape's labels, which may
    lack the suffix of the photographs' file names.

    Cameras that Metashape did not align have no pose; in a project without a scale, no camera has
    one. Raises HandbenchError for a lens that COLMAP cannot represent, and for a file that
    Metashape did not write.
    """
    root = read_parsed(path, "cameras exported by Metashape", "XML", fromstring, XML_BYTES)
    chunks = [c for c in root.iterfind("chunk") if c.find("cameras//camera") is not None]
    if len(chunks) != 1:
        raise HandbenchError(
            f"{path}: has {len(chunks)} Metashape chunks with cameras; expected exactly one; "
            "export the cameras of one chunk"
        )
    [chunk] = chunks
    sensors = {sensor.get("id"): sensor for sensor in chunk.iterfind("sensors/sensor")}
    parts = {part.get("id"): part for part in chunk.iterfind("components/component")}
    cameras = []
    for camera in chunk.iterfind("cameras//camera"):
        name = PureWindowsPath(camera.get("label", "")).name  # cuts at / and at \
        try:
            if (sensor_id := camera.get("sensor_id")) not in sensors:
                raise ValueError(f"the file has no sensor '{sensor_id}'")
            lens = _lens(sensors[sensor_id])
            frames = (parts.get(camera.get("component_id"), chunk), chunk)
            pose = _pose(camera, *(f for f in frames if f.find("transform/scale") is not None))
        except (ValueError, LookupError) as error:
            raise HandbenchError(
                f"{path}: camera {name}: is not usable ({error}); export the cameras again"
            ) from error
        cameras.append(parse(Camera, {"name": name} | lens | pose, f"{path}: camera {name}"))
    return tuple(cameras)


def _lens(sensor: Element) -> dict[str, Any]:
    """Read the lens of a sensor (Metashape's word for a lens and its calibration) as COLMAP's
    FULL_OPENCV: fields of Camera. Raises ValueError for a lens that this model does not cover."""
    size, *_ = sensor.iter("resolution")
    width, height = int(size.attrib["width"]), int(size.attrib["height"])
    # of class "adjusted", else "initial"
    calibration = min(sensor.iterfind("calibration"), key=lambda part: part.get("class", ""))
    if sensor.get("type", "frame") != "frame":
        raise ValueError("expected a frame camera")
    value = defaultdict[str, float](float)
    value |= {term.tag: float(term.text) for term in calibration if term.text}
    skew = abs(value["b2"]) * height / 2
    if skew >= SMALLEST_SKEW_PX * value["f"] or any(value[term] for term in NOT_IN_COLMAP):
        raise ValueError(
            f"COLMAP has no lens model with b2 or {' or '.join(NOT_IN_COLMAP)}; optimise the "
            "cameras with f, cx, cy, k1, k2, k3, p1, p2 (and b1) only"
        )
    fx, cx, cy = value["f"] + value["b1"], width / 2 + value["cx"], height / 2 + value["cy"]
    distortion = [value[term] for term in ("k1", "k2", "p2", "p1", "k3")]
    params = (fx, value["f"], cx, cy, *distortion, 0.0, 0.0, 0.0)
    return {"width": width, "height": height, "model": "FULL_OPENCV", "params": params}


def _pose(camera: Element, *frames: Element) -> dict[str, Any]:
    """Read the pose of a camera, as fields of Camera; empty if it was not aligned, or without a
    frame. frames: its component and chunk, without those that have no scale."""
    if camera.find("transform") is None or not frames:
        return {}
    pose = _numbers(camera, "transform", 4, 4)
    scale, rotation, translation_m = (
        _numbers(frames[0], f"transform/{part}", *shape)
        for part, shape in (("scale", ()), ("rotation", (3, 3)), ("translation", (3,)))
    )
    R = (rotation @ pose[:3, :3]).T
    centre_m = scale * rotation @ pose[:3, 3] + translation_m
    return {"R": R.tolist(), "t": (-R @ centre_m).tolist()}


def _numbers(element: Element, path: str, *shape: int) -> np.ndarray:
    """Read an array from the text of the XML element at `path` below `element`."""
    numbers = np.array((element.findtext(path) or "").split(), np.float64)
    if numbers.size != prod(shape):
        raise ValueError(f"its {path} has {numbers.size} numbers; expected {prod(shape)}")
    return numbers.reshape(shape)
