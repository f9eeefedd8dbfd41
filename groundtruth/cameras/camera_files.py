"""Readers of known cameras: handbench's cameras.json, COLMAP models and Metashape's XML."""

import posixpath
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from handbench.groundtruth.cameras.cameras import (
    Camera,
    camera_in,
    load_cameras,
    pycolmap,
    registered_images,
)
from handbench.groundtruth.cameras.metashape import read_metashape
from handbench.groundtruth.photos.photos import FEWEST, Photo
from handbench.support.config import parse
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, read_bytes, require_folder
from handbench.support.limits import MODEL_BYTES
from handbench.support.progress import say

FEWEST_POINTS = 20  # least number of points in a photograph of a model
# least and largest focal length over the picture's longer side, largest distortion
PLAUSIBLE = (0.1, 20.0, 100.0)

Named = TypeVar("Named", Camera, "pycolmap.Image")


def cameras_of(photos: tuple[Photo, ...], path: Path, metric: bool = False) -> tuple[Camera, ...]:
    """Read the camera of each photograph from a cameras.json, a COLMAP model's folder or
    Metashape's XML.

    metric: True if the poses of a COLMAP model are in metres; otherwise they are dropped, since
    COLMAP's poses have no unit. Returns one camera for each photograph, in their order. Raises
    HandbenchError if a photograph has no camera, or a camera of another picture size.
    """
    if path.is_dir():
        read = cameras_in(load_model(path, photos))
        if not metric:
            say(
                f"{path}: COLMAP's camera poses have no unit, so only the intrinsics are used; if "
                "the poses are in metres, give --metric"
            )
            read = tuple(camera.model_copy(update={"R": None, "t": None}) for camera in read)
    else:
        read = (read_metashape if path.suffix.lower() == ".xml" else load_cameras)(path)
    cameras = []
    for photo in photos:
        camera = _of_photo(photo, read, path)
        if camera is None:
            raise HandbenchError(
                f"{path}: has no camera for the photograph {photo.name}; add one, or remove the "
                "photograph"
            )
        _require_size(photo, camera.colmap(), path)
        cameras.append(camera.model_copy(update={"name": photo.name}))
    return tuple(cameras)


def load_model(folder: Path, photos: tuple[Photo, ...]) -> "pycolmap.Reconstruction":
    """Load the COLMAP model (text or binary) of these photographs.

    Its images are renamed after the photographs. Images without a photograph, and images that see
    very few of the model's points, are removed and reported. Raises HandbenchError if fewer than
    three images remain, or if a picture's size differs from that in the model.
    """
    model = read_model(folder)
    if any(len(frame.data_ids) > 1 for frame in model.frames.values()):
        raise HandbenchError(
            f"{folder}: has rigs of several cameras; expected single cameras; export the model "
            "again without rigs"
        )
    images = registered_images(model)
    photo_of = {
        image.name: photo for photo in photos if (image := _of_photo(photo, images, folder))
    }
    least = FEWEST_POINTS if model.num_points3D() else 0
    for image in images:
        photo = photo_of.get(image.name)
        if photo is None or image.num_points3D < least:
            say(
                f"{folder}: {image.name} is not among the photographs, or sees fewer than "
                f"{FEWEST_POINTS} points, so it is left out"
            )
            model.deregister_frame(image.frame_id)
        else:
            _require_size(photo, camera_in(image), folder)
            image.name = photo.name
    if len(registered_images(model)) < FEWEST:
        raise HandbenchError(
            f"{folder}: has cameras for {len(registered_images(model))} of the {len(photos)} "
            f"photographs; expected at least {FEWEST}, with the same file names"
        )
    return model


def read_model(folder: Path) -> "pycolmap.Reconstruction":
    """Read a COLMAP model (text or binary) from a folder. Raises HandbenchError if a file is broken
    or holds implausible cameras."""
    require_folder(folder, "a COLMAP model (cameras, images and points3D, .bin or .txt)")
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    try:
        _require_whole_points(folder)
        model = pycolmap.Reconstruction(str(folder))
    except (ValueError, IndexError, RuntimeError, MemoryError, OverflowError) as error:
        raise HandbenchError(
            f"{folder}: is not readable as a COLMAP model ({str(error)[:200]}); expected "
            "cameras, images and points3D, .bin or .txt"
        ) from error
    finally:
        pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    for image in model.images.values():
        image.name = one_form(image.name)
    for camera in cameras_in(model):
        if camera.colmap().has_bogus_params(*PLAUSIBLE):
            raise HandbenchError(
                f"{folder}: the lens of {camera.name} has impossible values; make the model again"
            )
    return model


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


def _of_photo(photo: Photo, named: Sequence[Named], where: Path) -> Named | None:
    """Return the camera or image of a photograph; None if there is none.

    Names are compared whole, then without folders, then also without suffix. where: the file that
    the cameras are from, for messages. Raises HandbenchError if two names match.
    """
    name = photo.name
    for cut in (str, posixpath.basename, lambda path: Path(path).stem):
        same = [one for one in named if cut(one.name) == cut(name)]
        if len(same) > 1:
            raise HandbenchError(
                f"{where}: {' and '.join(one.name for one in same)} may both be the photograph "
                f"{name}; rename one of them"
            )
        if same:
            return same[0]
    return None


def _require_size(photo: Photo, camera: "pycolmap.Camera", where: Path) -> None:
    if (camera.width, camera.height) != (photo.width, photo.height):
        raise HandbenchError(
            f"{where}: the camera of {photo.name} is for {camera.width} × {camera.height} pixels, "
            f"but the photograph has {photo.width} × {photo.height}; use cameras made from exactly "
            "these files"
        )


def write_model(model: "pycolmap.Reconstruction", folder: Path) -> None:
    """Write a COLMAP model into a folder, in binary form. Raises OSError if its last file is
    incomplete, as on a full disk, which COLMAP itself does not report."""
    model.write_binary(folder)
    try:
        _require_whole_points(folder)
    except ValueError as error:
        raise OSError("COLMAP's model was cut short; check that the disk has free space") from error


def _require_whole_points(folder: Path) -> None:
    """Raise ValueError if the length of a COLMAP model's points3D.bin does not agree with the
    counts in it, which COLMAP's reader trusts: it never returns from a file cut by 40 bytes."""
    file = folder / "points3D.bin"
    if not file.is_file():
        return
    content = read_bytes(file, "the points of a COLMAP model", MODEL_BYTES)
    end = 8
    try:
        for _ in range(struct.unpack_from("<Q", content)[0]):
            end += 51 + 8 * struct.unpack_from("<Q", content, end + 43)[0]
    except struct.error:
        end = -1
    if end != len(content):
        raise ValueError(
            f"the length of {file.name}, {len(content)} bytes, is not that of its contents"
        )
