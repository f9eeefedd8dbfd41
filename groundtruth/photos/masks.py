"""Masks of the pixels that show the target, read from files or segmented by colour."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from handbench.groundtruth.photos.photos import Photo, read_gray, sides_swapped, stored_picture
from handbench.support.errors import HandbenchError
from handbench.support.files import one_form, require_folder
from handbench.support.progress import say

if TYPE_CHECKING:
    import pycolmap

LONGEST_SIDE_PX = 500  # of the picture in which colours are segmented
ITERATIONS = 5
CENTRE = 0.8  # of the picture's sides: the ellipse that holds the target when there is no box
SMALLEST = 0.002  # share of the picture below which nothing was found


@dataclass(frozen=True)
class Masks:
    """Source of the target's masks.

    files: mask file of each photograph, by the photograph's name. by_colour: segment the target by
    its colours if there are no files.
    """

    files: dict[str, Path] = field(default_factory=dict)
    by_colour: bool = False

    def of(
        self,
        photo: Photo,
        camera: pycolmap.Camera,
        pose: pycolmap.Rigid3d,
        box_m: np.ndarray | None,
    ) -> np.ndarray | None:
        """Return the mask [height, width] of the pixels of a photograph that show the target; None
        if all pixels are to be used.

        camera, pose: the photograph's; pose maps world to camera. box_m [2, 3]: region of interest
        in the world frame (None: unknown), which limits the segmentation by colour.
        """
        if self.files:
            return read_mask(self.files[photo.name], photo)
        if not self.by_colour:
            return None
        found = cut_out(photo, _may_show(photo, camera, pose, box_m))
        if found is None:
            say(
                f"{photo.name}: the target cannot be separated from the background by colour, so "
                "the photograph is used without a mask"
            )
        return found


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


def cut_out(photo: Photo, candidates: np.ndarray) -> np.ndarray | None:
    """Segment the target in a photograph by colour: the largest region that differs from its
    surroundings, by GrabCut (Rother, Kolmogorov & Blake, SIGGRAPH 2004).

    candidates [height, width]: True at pixels that may show the target. Returns the region's mask
    [height, width]; None if no region differs enough.
    """
    scale = min(1.0, LONGEST_SIDE_PX / max(photo.width, photo.height))
    size = (round(photo.width * scale), round(photo.height * scale))
    picture = cv2.resize(photo.colours(), size, interpolation=cv2.INTER_AREA)
    inside = cv2.resize(candidates.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    if inside.all() or not inside.any():
        return None
    label = np.where(inside > 0, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    models = np.zeros((2, 1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(picture, label, None, models[0], models[1], ITERATIONS, cv2.GC_INIT_WITH_MASK)
    found = ((label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)).astype(np.uint8)
    found = cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((3, 3)))
    count, parts, figures, _ = cv2.connectedComponentsWithStats(found)
    if count < 2:
        return None
    areas = figures[1:, cv2.CC_STAT_AREA]
    if areas.max() < SMALLEST * parts.size:
        return None
    target = (parts == 1 + areas.argmax()).astype(np.float32)
    return cv2.resize(target, (photo.width, photo.height), interpolation=cv2.INTER_LINEAR) > 0.5


def _may_show(
    photo: Photo, camera: pycolmap.Camera, pose: pycolmap.Rigid3d, box_m: np.ndarray | None
) -> np.ndarray:
    """Return the mask [height, width] of the pixels that may show the target: the projection of
    box_m [2, 3] or, without a box, an ellipse in the picture's middle."""
    candidates = np.zeros((photo.height, photo.width), dtype=np.uint8)
    if box_m is None:
        axes = (round(CENTRE * photo.width / 2), round(CENTRE * photo.height / 2))
        cv2.ellipse(candidates, (photo.width // 2, photo.height // 2), axes, 0, 0, 360, 1, -1)
        return candidates > 0
    corners = pose * np.stack(np.meshgrid(*box_m.T), axis=-1).reshape(-1, 3)
    if (corners[:, 2] <= 0).any():  # a corner is behind the camera
        return candidates == 0
    pixels = np.asarray(camera.img_from_cam(corners)).astype(np.float32)
    cv2.fillConvexPoly(candidates, cv2.convexHull(pixels).round().astype(np.int32), 1)
    return candidates > 0
