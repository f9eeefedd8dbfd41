"""Photographs on disk: search, EXIF data, and detection of repeated, blurred and untextured ones.

Pixels are used as the sensor stored them, without the rotation in EXIF data, as in COLMAP: then all
photographs of a sensor share intrinsics, and a rotated camera has only another pose. A mask or
camera whose width and height are exchanged belongs to the upright picture, and is rotated to the
stored one. If a photograph's sides are equal, masks and cameras are assumed to belong to the stored
picture.
"""

import math
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, one_form, require_folder
from handbench.support.pictures import HEIC, SUFFIXES, is_deep, open_picture
from handbench.support.progress import say, track

IFD = 0x8769
MAKE, MODEL, ORIENTATION = 0x010F, 0x0110, 0x0112
SERIAL_NUMBER, FOCAL_LENGTH, FOCAL_LENGTH_35MM = 0xA431, 0x920A, 0xA405
FOCAL_PLANE_RESOLUTION, FOCAL_PLANE_UNIT, PIXELS_ACROSS = 0xA20E, 0xA210, 0xA002
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
DIAGONAL_35MM = math.hypot(36, 24)
PLAUSIBLE = (0.3, 10.0)  # focal length over the picture's longer side
# Pictures that handbench does not read; HEIC it reads where pillow-heif is installed.
UNREAD = {
    *HEIC,
    *(".avif", ".jxl", ".jp2", ".j2k", ".webp", ".bmp", ".gif", ".dng"),
    *(".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".pef", ".raw"),
}
FEWEST = 3
# EXIF orientation: clockwise, from the stored to the upright picture
QUARTER_TURNS = {1: 0, 3: 2, 6: 1, 8: 3}
MIRRORED = (2, 4, 5, 7)  # EXIF orientations that no camera writes
QUALITY_PX = 1000  # longer side at which quality is measured
DIRECTIONS = 8
FEWEST_FEATURES = 40  # of a photograph that may register
# sharpness, against the median's: a blur of about 1.2 px (standard deviation) at LOOK_PX
BLURRED = 0.5

Exif = dict[int, Any]  # tag → value


def read_exif(path: Path) -> Exif:
    """Read the EXIF data of a picture file, as a dict from tag number to value; empty if the data
    are missing or broken."""
    try:
        with open_picture(path) as image:
            exif = image.getexif()
            return {**exif, **exif.get_ifd(IFD)}
    except (HandbenchError, TypeError, KeyError, struct.error):
        return {}


def orientation_of(exif: Exif) -> int:
    """Return the EXIF orientation, a number 1 to 8 that says how to rotate the picture for display.
    1, the default, means not at all."""
    value = exif.get(ORIENTATION, 1)
    return int(value) if value in range(1, 9) else 1


def body_of(exif: Exif, size: tuple[int, int]) -> tuple[str, ...] | None:
    """Return texts that identify the camera, its focal length and the picture's size; they are
    equal for photographs taken with the same lens setting. None if EXIF data do not name the
    camera."""
    if MODEL not in exif:
        return None
    return tuple(str(exif.get(tag)) for tag in (MAKE, MODEL, SERIAL_NUMBER, FOCAL_LENGTH)) + (
        str(size),
    )


def focal_length_px(exif: Exif, width: int, height: int) -> float | None:
    """Compute the focal length in pixels from EXIF data.

    Its equivalent on 35 mm film is converted by the ratio of diagonals (as COLMAP does); if that is
    missing, the focal length in millimetres by the sensor's pixels per millimetre (which COLMAP
    ignores). Returns None if EXIF data have neither, or an implausible value.
    """
    equivalent_mm = _number(exif, FOCAL_LENGTH_35MM)
    if equivalent_mm > 0:
        focal_px = equivalent_mm / DIAGONAL_35MM * math.hypot(width, height)
    else:
        unit_mm = UNIT_MM.get(int(_number(exif, FOCAL_PLANE_UNIT)), UNIT_MM[2])
        shrunk = max(width, height) / (_number(exif, PIXELS_ACROSS) or max(width, height))
        focal_px = (
            _number(exif, FOCAL_LENGTH) * _number(exif, FOCAL_PLANE_RESOLUTION) / unit_mm * shrunk
        )
    return focal_px if is_plausible(focal_px, width, height) else None


def is_plausible(focal_px: float, width: int, height: int) -> bool:
    """Tell whether a focal length in pixels is plausible for a picture of this size."""
    low, high = (share * max(width, height) for share in PLAUSIBLE)
    return low < focal_px < high


def _number(exif: Exif, tag: int) -> float:
    """Return the value of an EXIF tag as a number; 0 if it is missing or not a finite number."""
    try:
        value = float(exif.get(tag, 0))
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return value if math.isfinite(value) else 0.0


@dataclass(frozen=True)
class Photo:
    """One photograph: its file, name, size in pixels as stored, and EXIF data.

    body: texts that are equal for photographs of the same camera at the same focal length (None:
    not in EXIF data). orientation: EXIF's code 1, 3, 6 or 8 for the rotation to the upright
    picture. focal_px: approximate focal length in pixels (None: not in EXIF data).
    """

    path: Path
    name: str
    width: int
    height: int
    body: tuple[str, ...] | None = None
    orientation: int = 1
    focal_px: float | None = None

    def gray(self) -> np.ndarray:
        """Read the gray values [height, width] of the stored pixels, float32 in 0 … 1."""
        return read_gray(self.path)

    def colours(self) -> np.ndarray:
        """Read the colours [height, width, 3] of the stored pixels, uint8 in the order red, green,
        blue."""
        with open_picture(self.path) as image:
            return _colours(image, self.path)


def find_photos(folder: str | Path) -> tuple[Photo, ...]:
    """Find the photographs in `folder` or, if it has none, in `folder/images`, sorted by name.

    Each photograph is decoded once, so that a broken file is reported before any work starts.
    Raises HandbenchError for a broken file, and if there are fewer than three photographs.
    """
    folder = require_folder(folder, "photographs")
    paths = _pictures(folder) or _pictures(folder / "images")
    twice = [name for name, count in Counter(one_form(p.name) for p in paths).items() if count > 1]
    if twice:
        raise HandbenchError(
            f"{folder}: two photographs are called {twice[0]}, with accents written in two ways; "
            "rename one of them"
        )
    unread = [
        path.name
        for path in _files(paths[0].parent if paths else folder)
        if path.suffix.lower() in UNREAD and path not in paths
    ]
    others = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
    left_out = (
        (f"{one_form(unread[0])}{others}: left out, because it is not JPEG, PNG or TIFF")
        if unread
        else ""
    )
    if len(paths) < FEWEST:
        raise HandbenchError(
            f"{folder}: found only {len(paths)} photographs ({', '.join(SUFFIXES)}) in it and in "
            f"images/; expected at least {FEWEST}; 5 to 12 from different sides are good"
            + (f" ({left_out})" if left_out else "")
        )
    if left_out:
        say(left_out)
    return tuple(_open(path) for path in paths)


def read_gray(path: Path) -> np.ndarray:
    """Read a picture file as gray values [height, width], float32 in 0 … 1.

    The picture may be gray, in colours, with a palette or CMYK, with 8 or 16 bits a channel.
    Transparency is ignored, as in COLMAP.
    """
    with open_picture(path) as image:
        return _gray(image, path)


def sides_swapped(photo: Photo, width: int, height: int) -> bool:
    """Tell whether width × height is the size of the photograph's upright picture and differs from
    that of its stored pixels."""
    turned = QUARTER_TURNS[photo.orientation] % 2 == 1 and photo.width != photo.height
    return turned and (width, height) == (photo.height, photo.width)


def stored_picture(photo: Photo, upright: np.ndarray) -> np.ndarray:
    """Rotate an upright picture [width, height, ...] back to the photograph's stored pixels
    [height, width, ...], where height and width are the stored ones."""
    return np.rot90(upright, QUARTER_TURNS[photo.orientation])


def _gray(image: Image.Image, path: Path) -> np.ndarray:
    import cv2

    if image.mode in ("I", "F"):
        raise HandbenchError(
            f"{path}: has 32 bits per pixel; save it with 8 or 16 bits per channel"
        )
    if not is_deep(image):
        gray: np.ndarray = np.array(image.convert("L"), dtype=np.float32)
        gray /= 255  # in place: a large picture has no room for two
        return gray
    image.load()  # complains of a truncated file, where OpenCV fills up
    deep = cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if deep is None:
        raise ValueError("OpenCV cannot read its 16-bit channels")
    deep = deep.astype(np.float32) / 65535
    return deep if deep.ndim == 2 else cv2.cvtColor(deep[..., :3], cv2.COLOR_BGR2GRAY)


def _colours(image: Image.Image, path: Path) -> np.ndarray:
    if image.mode.startswith("I"):
        return np.repeat((_gray(image, path) * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def _pictures(folder: Path) -> list[Path]:
    return [path for path in _files(folder) if path.suffix.lower() in SUFFIXES]


def _files(folder: Path) -> list[Path]:
    """List the visible entries of a folder, sorted by name; empty if the folder does not exist."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if not path.name.startswith("."))


def _open(path: Path) -> Photo:
    height, width = read_gray(path).shape
    exif = read_exif(path)
    orientation = orientation_of(exif)
    if orientation in MIRRORED:
        raise HandbenchError(
            f"{path}: its EXIF orientation {orientation} says that the picture is mirrored, which "
            "no camera does; save it unmirrored"
        )
    body = body_of(exif, (width, height))
    return Photo(
        path,
        one_form(path.name),
        width,
        height,
        body,
        orientation,
        focal_length_px(exif, width, height),
    )


@dataclass(frozen=True)
class PhotoQuality:
    """Quality of one photograph.

    pixels: hash of the pixels. sharpness: a ratio without unit that is comparable only between
    photographs of one scene. features: number of SIFT features, counted in the picture's middle
    only if these suffice.
    """

    pixels: str
    sharpness: float
    features: int


def select_usable(photos: tuple[Photo, ...]) -> tuple[Photo, ...]:
    """Return the photographs without duplicates and without those that are blurred compared with
    the others.

    Removed photographs are reported. Blurred ones are kept if fewer than three would be left.
    Raises HandbenchError if fewer than three photographs differ, or if fewer than three show enough
    texture.
    """
    looks = {photo.name: photo_quality(photo) for photo in track(photos, "looking")}
    first = {look.pixels: name for name, look in reversed(looks.items())}
    for name, look in looks.items():
        if first[look.pixels] != name:
            say(f"{name}: has the same pixels as {first[look.pixels]}, so it is left out")
    photos = tuple(photo for photo in photos if first[looks[photo.name].pixels] == photo.name)
    folder = photos[0].path.parent
    if len(photos) < FEWEST:
        raise HandbenchError(
            f"{folder}: only {len(photos)} photographs are different; expected at least {FEWEST}"
        )
    textured = sum(looks[photo.name].features >= FEWEST_FEATURES for photo in photos)
    if textured < FEWEST:
        raise HandbenchError(
            f"{folder}: only {textured} of {len(photos)} photographs show enough texture "
            f"({FEWEST_FEATURES} features); expected at least {FEWEST}; add light, focus on the "
            "hand, and put a print with fine detail around it"
        )
    return _without_blurred(photos, looks)


def _without_blurred(
    photos: tuple[Photo, ...], looks: dict[str, PhotoQuality]
) -> tuple[Photo, ...]:
    typical = np.median([looks[photo.name].sharpness for photo in photos])
    blurred = [photo for photo in photos if looks[photo.name].sharpness < BLURRED * typical]
    spared = len(photos) - len(blurred) >= FEWEST
    for photo in blurred:
        share, what = (
            looks[photo.name].sharpness / typical,
            "left out" if spared else "used, because there are only a few photographs",
        )
        say(f"{photo.name}: is blurred ({share:.0%} of the typical sharpness); {what}")
    return tuple(photo for photo in photos if photo not in blurred) if spared else photos


def photo_quality(photo: Photo) -> PhotoQuality:
    """Measure the quality of a photograph: hash of its pixels, sharpness and number of features.

    Sharpness is the variance of the second derivative over that of the first, in the direction in
    which this ratio is smallest. It does not depend on contrast or plain areas, and it detects
    motion blur along a line.
    """
    import cv2

    gray = photo.gray()
    pixels = content_hash(gray)
    scale = QUALITY_PX / max(gray.shape)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    slopes = np.gradient(gray)  # by row and by column
    (yy, yx), (xy, xx) = (np.gradient(slope) for slope in slopes)
    angles_rad = np.linspace(0, np.pi, DIRECTIONS, endpoint=False)
    sharpness = np.inf
    for cosine, sine in zip(np.cos(angles_rad), np.sin(angles_rad), strict=True):
        slope = cosine * slopes[1] + sine * slopes[0]
        bend = cosine**2 * xx + cosine * sine * (xy + yx) + sine**2 * yy
        sharpness = min(sharpness, float(bend.var() / max(slope.var(), 1e-12)))
    return PhotoQuality(pixels, sharpness, _features((gray * 255).round().astype(np.uint8)))


def _features(gray: np.ndarray) -> int:
    """Count the SIFT features of a picture [height, width], uint8: those in its middle quarter if
    they suffice, else all. The whole picture takes four times as long."""
    import cv2

    h, w = gray.shape
    sift = cv2.SIFT_create()
    middle = len(sift.detect(gray[h // 4 : h - h // 4, w // 4 : w - w // 4], None))
    return middle if middle >= FEWEST_FEATURES else len(sift.detect(gray, None))
