"""Readers of known cameras: handbench's cameras.json, COLMAP models and Metashape's XML.

Binary COLMAP models are checked before COLMAP reads them: its reader trusts every count in a file,
so that it never returns from a points3D.bin that was cut by 40 bytes, and reads one cut by 1 byte.
"""

import struct
from collections.abc import Sequence
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from handbench.groundtruth.cameras.cameras import (
    Camera,
    camera_in,
    load_cameras,
    pycolmap,
    registered_images,
)
from handbench.groundtruth.cameras.metashape import read_metashape
from handbench.groundtruth.photos.photos import FEWEST, QUARTER_TURNS, Photo, sides_swapped
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, read_bytes, read_text, require_folder, require_size
from handbench.support.limits import MODEL_BYTES
from handbench.support.progress import say

FEWEST_POINTS = 20  # least number of points in a photograph of a model
# parameters of lens models that can be rotated
TURNABLE = {"f", "fx", "fy", "cx", "cy", "k", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}
# least and largest focal length over the picture's longer side, largest distortion
PLAUSIBLE = (0.1, 20.0, 100.0)
KINDS = ("cameras", "images", "points3D", "rigs", "frames")


def cameras_of(photos: tuple[Photo, ...], path: Path, metric: bool = False) -> tuple[Camera, ...]:
    """Read the camera of each photograph from a cameras.json, a COLMAP model's folder or
    Metashape's XML.

    metric: True if the poses of a COLMAP model are in metres; otherwise they are dropped, since
    COLMAP's poses have no unit. Returns one camera for each photograph, in their order, for its
    pixels as stored in the file. Raises HandbenchError if a photograph has no camera, or a camera
    of another picture size.
    """
    if path.is_dir():
        known = cameras_in(read_model(path))
        if not metric:
            say(
                f"{path}: COLMAP's camera poses have no unit, so only the intrinsics are used; if "
                "the poses are in metres, give --metric"
            )
            known = tuple(camera.model_copy(update={"R": None, "t": None}) for camera in known)
    else:
        known = (read_metashape if path.suffix.lower() == ".xml" else load_cameras)(path)
    cameras = []
    for photo, camera in _pairs(photos, known, path):
        if camera is None:
            raise HandbenchError(
                f"{path}: has no camera for the photograph {photo.name}; add one, or remove the "
                "photograph"
            )
        if sides_swapped(photo, camera.width, camera.height):
            camera = stored_camera(photo, camera)
        _require_size(photo, camera.width, camera.height, path)
        camera.colmap()
        cameras.append(camera.model_copy(update={"name": photo.name}))
    return tuple(cameras)


def load_model(folder: Path, photos: tuple[Photo, ...]) -> "pycolmap.Reconstruction":
    """Load the COLMAP model (text or binary) of these photographs.

    Its images are renamed after the photographs. Images without a photograph, and images that see
    very few of the model's points, are removed and reported. Raises HandbenchError if fewer than
    three images remain, or if a picture's size differs from that in the model.
    """
    model = read_model(folder)
    images = registered_images(model)
    if any(len(frame.data_ids) > 1 for frame in model.frames.values()):
        raise HandbenchError(
            f"{folder}: has rigs of several cameras; expected single cameras; export the model "
            "again without rigs"
        )
    empty = not model.num_points3D()
    photo_of = {
        image.name: photo for photo, image in _pairs(photos, images, folder) if image is not None
    }
    for image in images:
        photo = photo_of.get(image.name)
        if photo is not None:
            _require_size(photo, camera_in(image).width, camera_in(image).height, folder)
        if not image.has_pose:  # gone with another image of its rig
            continue
        if photo is None or (image.num_points3D < FEWEST_POINTS and not empty):
            why = (
                "is not among the photographs"
                if photo is None
                else f"sees only {image.num_points3D} points"
            )
            say(f"{folder}: {image.name} {why}, so it is left out")
            model.deregister_frame(image.frame_id)
        else:
            image.name = photo.name
    if len(registered_images(model)) < FEWEST:
        raise HandbenchError(
            f"{folder}: has cameras for {len(registered_images(model))} of the {len(photos)} "
            f"photographs; expected at least {FEWEST}, with the same file names"
        )
    return model


def read_model(folder: Path) -> "pycolmap.Reconstruction":
    """Read a COLMAP model (text or binary) from a folder. Raises HandbenchError if a file is broken
    or holds implausible numbers."""
    require_folder(folder, "a COLMAP model (cameras, images and points3D, .bin or .txt)")
    check_model(folder)
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    try:
        model = pycolmap.Reconstruction(str(folder))
        if not (folder / "images.bin").is_file():
            _require_whole_names(folder / "images.txt")
        for image in model.images.values():
            image.name = one_form(image.name)
    except (ValueError, IndexError, RuntimeError, MemoryError, OverflowError) as error:
        raise HandbenchError(
            f"{folder}: is not readable as a COLMAP model ({str(error)[:200]}); expected "
            "cameras, images and points3D, "
            ".bin or .txt"
        ) from error
    finally:
        pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    numbers = [image.cam_from_world().matrix() for image in registered_images(model)]
    lenses = [camera_in(image) for image in registered_images(model)]  # others are nobody's
    numbers += [camera.params for camera in lenses]
    numbers += [point.xyz for point in model.points3D.values()]
    broken = not all(np.isfinite(part).all() for part in numbers) or not all(
        map(_is_rigid, registered_images(model))
    )
    if broken or any(min(c.width, c.height) == 0 or c.has_bogus_params(*PLAUSIBLE) for c in lenses):
        raise HandbenchError(
            f"{folder}: its cameras, poses or points have impossible values; make the model again"
        )
    return model


def _require_whole_names(images: Path) -> None:
    """Raise ValueError if a name in a text model's list of images has a space, where pycolmap cuts
    it."""
    text = read_text(images, "the images of a COLMAP model", MODEL_BYTES)
    lines = [line for line in text.split("\n") if not line.startswith("#")]
    for line in lines[::2]:  # each other one lists the points that its image sees
        if len(line.split()) > 10:
            raise ValueError(f"the name in '{line}' has a space; export the model as binary")


def _is_rigid(image: "pycolmap.Image") -> bool:
    """Tell whether the matrix of an image's pose is a rotation; it is none if the file's quaternion
    does not have unit length."""
    R = image.cam_from_world().rotation.matrix()
    return bool(np.abs(R).max() < 2 and np.abs(R @ R.T - np.eye(3)).max() < 1e-3)


def cameras_in(model: "pycolmap.Reconstruction") -> tuple[Camera, ...]:
    """Return the cameras, with lens and pose, of all images of a model that have a pose, sorted by
    name."""
    cameras = []
    for image in registered_images(model):
        camera, pose = camera_in(image), image.cam_from_world()
        found = Camera(
            name=image.name,
            width=camera.width,
            height=camera.height,
            model=camera.model_name,
            params=tuple(camera.params.tolist()),
            R=tuple(map(tuple, pose.rotation.matrix().tolist())),
            t=tuple(pose.translation.tolist()),
        )
        cameras.append(found)
    return tuple(cameras)


def stored_camera(photo: Photo, camera: Camera) -> Camera:
    """Convert a camera that was calibrated on the upright picture to the photograph's stored
    pixels.

    An upright picture is the stored one rotated according to its EXIF orientation: each rotation by
    90° clockwise moves (x, y) to (height − y, x). Raises HandbenchError for a lens model whose
    parameters cannot be rotated.
    """
    names = [name.strip() for name in camera.colmap().params_info.split(",")]
    if not TURNABLE.issuperset(names):
        raise HandbenchError(
            f"camera {camera.name}: is calibrated for the upright picture, but its model "
            f"{camera.model} cannot be rotated to the stored pixels; calibrate with pictures "
            "without EXIF orientation"
        )
    back = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for _ in range(QUARTER_TURNS[photo.orientation]):
        value = dict(zip(names, camera.params, strict=True))
        turned = dict(value, cx=value["cy"], cy=camera.width - value["cx"])
        for name, source, sign in (
            ("fx", "fy", 1),
            ("fy", "fx", 1),
            ("p1", "p2", -1),
            ("p2", "p1", 1),
        ):
            if name in value:
                turned[name] = sign * value[source]
        update = {
            "width": camera.height,
            "height": camera.width,
            "params": tuple(turned[name] for name in names),
        }
        if camera.R is not None:
            update["R"] = tuple(map(tuple, (back @ camera.rotation).tolist()))
        if camera.t is not None:
            update["t"] = tuple((back @ camera.translation_m).tolist())
        camera = camera.model_copy(update=update)
    return camera


def _pairs(
    photos: tuple[Photo, ...], named: "Sequence[Camera] | Sequence[pycolmap.Image]", where: Path
) -> list[tuple[Photo, Any]]:
    """Assign to each photograph the camera or image of the same name.

    Names are compared whole, then without folders, then also without suffix. where: the file that
    the cameras are from, for messages. Returns (photograph, camera or image) for each photograph,
    with None where no name matches. Raises HandbenchError if two names match one photograph.
    """
    short = (str, lambda name: PurePosixPath(name).name, lambda name: PurePosixPath(name).stem)
    known = [(cut, [(cut(n.name), n) for n in named]) for cut in short]
    pairs = []
    for photo in photos:
        same = ([n for name, n in those if name == cut(photo.name)] for cut, those in known)
        found = next(filter(None, same), [None])
        if len(found) > 1:
            raise HandbenchError(
                f"{where}: {' and '.join(n.name for n in found)} may both be the photograph "
                f"{photo.name}; rename one of them"
            )
        pairs.append((photo, found[0]))
    return pairs


def _require_size(photo: Photo, width: int, height: int, where: Path) -> None:
    if (width, height) != (photo.width, photo.height):
        cure = "use cameras made from exactly these files"
        if (height, width) == (photo.width, photo.height):
            cure = (
                "if the camera is rotated by 90°, exchange width and height, fx and fy, and cx "
                "and cy"
            )
        raise HandbenchError(
            f"{where}: the camera of {photo.name} is for {width} × {height} pixels, but the "
            f"photograph has {photo.width} × {photo.height}; {cure}"
        )


def check_model(folder: Path) -> None:
    """Check the files of a COLMAP model before COLMAP reads them. Raises HandbenchError if a file
    is too large, or if a binary file's length does not agree with the counts in it."""
    for name in KINDS:
        file = folder / f"{name}.bin"
        if not file.is_file():
            if (text := file.with_suffix(".txt")).is_file():
                require_size(text, "a part of a COLMAP model", MODEL_BYTES)
            continue
        content = read_bytes(file, "a part of a COLMAP model", MODEL_BYTES)
        try:
            end = _length(content, name)
        except (struct.error, ValueError, KeyError):
            end = -1
        if end != len(content):
            raise HandbenchError(
                f"{folder}: is not readable as a COLMAP model (the length of {file.name}, "
                f"{len(content)} bytes, does not fit its contents); copy it again"
            )


def write_model(model: "pycolmap.Reconstruction", folder: Path) -> None:
    """Write a COLMAP model into a folder, in binary form. Raises OSError if a file is incomplete,
    as on a full disk, which COLMAP itself does not report."""
    model.write_binary(folder)
    try:
        check_model(folder)
    except HandbenchError as error:
        raise OSError("COLMAP's model was cut short; check that the disk has free space") from error


def _length(content: bytes, kind: str) -> int:
    """Compute the length in bytes that a binary file of a COLMAP model should have, from the counts
    in it.

    kind: name of the file without suffix, such as "images". Raises struct.error or ValueError if
    the counts need more bytes than the file has, and KeyError for an unknown lens model.
    """

    def number(form: str, at: int) -> int:
        return int(struct.unpack_from(form, content, at)[0])

    end = 8
    for _ in range(number("<Q", 0)):
        match kind:
            case "cameras":
                end += 24 + 8 * _parameters()[number("<i", end + 4)]
            case "images":
                end = content.index(b"\0", end + 64) + 1
                end += 8 + 24 * number("<Q", end)
            case "points3D":
                end += 51 + 8 * number("<Q", end + 43)
            case "rigs":
                sensors = number("<I", end + 4)
                end += 16 if sensors else 8  # the first is the reference, and has no pose
                for _ in range(1, sensors):
                    end += 65 if number("B", end + 8) else 9
            case "frames":
                end += 68 + 16 * number("<I", end + 64)
        if end > len(content):
            raise ValueError("the file is cut short")
    return end


@cache
def _parameters() -> dict[int, int]:
    """Return a dict from the number of each of COLMAP's lens models to its count of parameters."""
    models = [
        model for name, model in pycolmap.CameraModelId.__members__.items() if name != "INVALID"
    ]
    return {
        int(model): len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 1, 1).params)
        for model in models
    }
