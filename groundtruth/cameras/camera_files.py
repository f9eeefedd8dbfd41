"""Readers of known cameras: handbench's cameras.json, COLMAP models and Metashape's XML."""

import posixpath
import struct
from pathlib import Path

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

# least and largest focal length over the picture's longer side, largest distortion
PLAUSIBLE = (0.1, 20.0, 100.0)


def cameras_of(photos: tuple[Photo, ...], path: Path) -> tuple[Camera, ...]:
    """Read the camera of each photograph from a cameras.json, a COLMAP model's folder or
    Metashape's XML.

    Returns the cameras in the photographs' order. A photograph that a COLMAP model lacks has none,
    which is reported. Raises HandbenchError if another file has no camera for a photograph, if
    fewer than three remain, or for a camera of another picture size.
    """
    if path.is_dir():
        read = cameras_in(read_model(path))
    else:
        read = (read_metashape if path.suffix.lower() == ".xml" else load_cameras)(path)
    cameras = []
    for photo in photos:
        camera = _of_photo(photo, read, path)
        if camera is None and path.is_dir():
            say(f"{path}: has no camera for the photograph {photo.name}, which is left out")
            continue
        if camera is None:
            raise HandbenchError(
                f"{path}: has no camera for the photograph {photo.name}; add one, or remove the "
                "photograph"
            )
        if (camera.width, camera.height) != (photo.width, photo.height):
            raise HandbenchError(
                f"{path}: the camera of {photo.name} is for {camera.width} × {camera.height} "
                f"pixels, but the photograph has {photo.width} × {photo.height}; use cameras made "
                "from exactly these files"
            )
        camera.colmap()
        cameras.append(camera.model_copy(update={"name": photo.name}))
    if path.is_dir() and len(cameras) < FEWEST:
        raise HandbenchError(
            f"{path}: has cameras for {len(cameras)} of the {len(photos)} photographs; expected "
            f"at least {FEWEST}, with the same file names"
        )
    return tuple(cameras)


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


def _of_photo(photo: Photo, cameras: tuple[Camera, ...], where: Path) -> Camera | None:
    """Return the camera of a photograph; None if there is none.

    Names are compared whole, then without folders, then also without suffix. where: the file that
    the cameras are from, for messages. Raises HandbenchError if two names match.
    """
    name = photo.name
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
