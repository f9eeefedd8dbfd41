"""Masks of the pixels that show the target, read from files."""

from pathlib import Path

import numpy as np

from handbench.groundtruth.photos.photos import Photo, read_gray, sides_swapped, stored_picture
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, require_folder
from handbench.support.progress import say


def find_masks(folder: str | Path, photos: tuple[Photo, ...]) -> dict[str, Path]:
    """Find the mask file of each photograph in a folder: NAME.jpg.png (as for COLMAP) or NAME.png,
    nonzero on the target.

    Returns the files by the photographs' names. Each file is read once as a check. Raises
    HandbenchError if a mask is missing, zero everywhere, or of another size than its photograph.
    """
    folder = require_folder(folder, "masks (NAME.jpg.png or NAME.png)")
    pictures = {one_form(file.name): file for file in folder.glob("*.png")}
    masks = {}
    for photo in photos:
        names = [f"{name}.png" for name in (photo.name, Path(photo.name).stem)]
        if there := [pictures[name] for name in names if name in pictures]:
            masks[photo.name] = there[0]
    missing = [photo.name for photo in photos if photo.name not in masks]
    if missing:
        raise HandbenchError(
            f"{folder}: has no mask for {', '.join(missing)}; add {missing[0]}.png or "
            f"{Path(missing[0]).stem}.png with nonzero pixels on the target"
        )
    for photo in photos:
        read_mask(masks[photo.name], photo)
        if photo.orientation == 3:
            say(
                f"{photo.name}: EXIF says that it is upside down; its mask must fit the stored "
                "pixels, which are not turned"
            )
    return masks


def read_mask(path: Path, photo: Photo) -> np.ndarray:
    """Read the mask [height, width] of a photograph: True at the file's nonzero pixels.

    A mask with the size of the upright picture is rotated to the photograph's stored pixels, if
    EXIF data say that the two differ. Raises HandbenchError for another size, and for a mask that
    is zero everywhere.
    """
    mask = read_gray(path) > 0
    height, width = mask.shape
    if sides_swapped(photo, width, height):
        mask = stored_picture(photo, mask)
    elif (width, height) != (photo.width, photo.height):
        raise HandbenchError(
            f"{path}: is a mask of {width} × {height} pixels, but {photo.name} has {photo.width} "
            f"× {photo.height}; make the mask in the size of the photograph"
        )
    if not mask.any():
        raise HandbenchError(
            f"{path}: is a mask that is zero everywhere; make the pixels on the target nonzero"
        )
    return mask
