"""Photographs on disk: found, checked and read.

Pixels are taken as the sensor stored them: an EXIF orientation is ignored here as in COLMAP, because intrinsics belong
to the sensor, and a camera that was turned is nothing but another pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import HandbenchError, require_folder

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
FEWEST = 3
EXIF_IFD = 0x8769
BODY_TAGS = (0x010F, 0x0110)  # make, model
LENS_TAGS = (0xA431, 0x920A)  # serial number of the body, focal length


@dataclass(frozen=True)
class Photo:
    """One photograph: `name` inside its folder, size in pixels, and `body`, equal for photographs whose EXIF data name
    the same camera and focal length (None without such data)."""

    path: Path
    name: str
    width: int
    height: int
    body: tuple[str, ...] | None = None

    def gray(self) -> np.ndarray:
        """Intensities [height, width], float32 in 0 … 1."""
        return read_gray(self.path)


def find_photos(folder: str | Path) -> tuple[Photo, ...]:
    """The photographs in `folder` or in `folder/images`, by name; every one is decoded once, so that a broken file is
    reported before any work starts. At least three are needed."""
    folder = require_folder(folder, "photographs")
    paths = _pictures(folder) or _pictures(folder / "images")
    if len(paths) < FEWEST:
        raise HandbenchError(
            f"{folder}: found {len(paths)} photographs ({', '.join(SUFFIXES)}), here and in images/; "
            f"at least {FEWEST} are needed, 5 to 12 from different sides are good"
        )
    return tuple(_open(path) for path in paths)


def read_gray(path: Path) -> np.ndarray:
    """A picture file as intensities [height, width], float32 in 0 … 1 (8 or 16 bits a channel)."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            if image.mode.startswith("I;16"):
                return np.asarray(image, dtype=np.float32) / 65535
            return np.asarray(image.convert("L"), dtype=np.float32) / 255
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise HandbenchError(f"{path}: is not a readable photograph ({error}); replace or remove it") from error


def _pictures(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))


def _open(path: Path) -> Photo:
    height, width = read_gray(path).shape
    return Photo(path, path.name, width, height, _body(path, (width, height)))


def _body(path: Path, size: tuple[int, int]) -> tuple[str, ...] | None:
    from PIL import Image

    with Image.open(path) as image:
        exif = image.getexif()
        details = exif.get_ifd(EXIF_IFD)
    if BODY_TAGS[1] not in exif:
        return None
    return tuple(str(exif.get(t)) for t in BODY_TAGS) + tuple(str(details.get(t)) for t in LENS_TAGS) + (str(size),)
