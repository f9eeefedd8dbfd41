"""Masks of the pixels that show the target, from files and from the photographs' alpha channels."""

from pathlib import Path

import numpy as np

from handbench.groundtruth.photos.photos import Photo, read_alpha, read_gray
from handbench.groundtruth.photos.pictures import ORIENTATION, open_picture
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, require_folder

# ORIENTATION's value → quarter turns from the upright to the stored picture
TURNS = {6: 1, 8: 3}


def read_mask(photo: Photo, folder: Path | None) -> np.ndarray:
    """Read the mask [height, width] of a photograph: True at the pixels that are not transparent
    and, in the mask file in `folder` (None: there is none), not zero.

    The file is NAME.jpg.png (as for COLMAP) or NAME.png, in the size of the photograph. If its
    sides are exchanged and EXIF data say that the picture is rotated, it belongs to the upright
    picture and is rotated to the stored pixels. Raises HandbenchError if the file is missing or of
    another size, and for a mask without a pixel.
    """
    path, mask = photo.path, read_alpha(photo.path)
    if folder is not None:
        path = _mask_file(photo, folder)
        drawn = read_gray(path) > 0
        height, width = drawn.shape
        if height != width and (width, height) == (photo.height, photo.width):
            with open_picture(photo.path) as image:
                drawn = np.rot90(drawn, TURNS.get(image.getexif().get(ORIENTATION, 1), 0))
        if drawn.shape != (photo.height, photo.width):
            raise HandbenchError(
                f"{path}: is a mask of {width} × {height} pixels, but {photo.name} has "
                f"{photo.width} × {photo.height}; make the mask in the size of the photograph"
            )
        mask &= drawn
    if not mask.any():
        raise HandbenchError(
            f"{path}: is a mask that is zero everywhere; make the pixels on the target nonzero"
        )
    return mask


def _mask_file(photo: Photo, folder: Path) -> Path:
    require_folder(folder, "masks (NAME.jpg.png or NAME.png)")
    files = {one_form(file.name): file for file in folder.glob("*.png")}
    names = [f"{name}.png" for name in (photo.name, Path(photo.name).stem)]
    for name in names:
        if name in files:
            return files[name]
    raise HandbenchError(
        f"{folder}: has no mask for {photo.name}; add {' or '.join(names)} with nonzero pixels on "
        "the target"
    )
