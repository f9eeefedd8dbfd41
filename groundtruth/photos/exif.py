"""EXIF data of a photograph: camera body, orientation, focal length."""

import math
import struct
from pathlib import Path
from typing import Any

from handbench.support.errors import HandbenchError
from handbench.support.pictures import opened_picture

IFD = 0x8769
MAKE, MODEL, ORIENTATION = 0x010F, 0x0110, 0x0112
SERIAL_NUMBER, FOCAL_LENGTH, FOCAL_LENGTH_35MM = 0xA431, 0x920A, 0xA405
FOCAL_PLANE_RESOLUTION, FOCAL_PLANE_UNIT, PIXELS_ACROSS = 0xA20E, 0xA210, 0xA002
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
DIAGONAL_35MM = math.hypot(36, 24)
PLAUSIBLE = (0.3, 10.0)  # focal length over the picture's longer side

Exif = dict[int, Any]


def read_exif(path: Path) -> Exif:
    """Tag → value of a picture file; empty where there are none or they are broken."""
    try:
        with opened_picture(path) as image:
            exif = image.getexif()
            return {**exif, **exif.get_ifd(IFD)}
    except (HandbenchError, TypeError, KeyError, struct.error):
        return {}


def orientation_of(exif: Exif) -> int:
    """Orientation by which a viewer turns the picture: 1 (not at all) to 8."""
    value = exif.get(ORIENTATION, 1)
    return int(value) if value in range(1, 9) else 1


def body_of(exif: Exif, size: tuple[int, int]) -> tuple[str, ...] | None:
    """Equal for photographs of one camera at one focal length and size; None where the camera is not named."""
    if MODEL not in exif:
        return None
    return tuple(str(exif.get(tag)) for tag in (MAKE, MODEL, SERIAL_NUMBER, FOCAL_LENGTH)) + (str(size),)


def focal_length_px(exif: Exif, width: int, height: int) -> float | None:
    """Focal length in pixels: from its equivalent on 35 mm film, whose diagonal stands for the picture's (as COLMAP
    does), or in millimetres and pixels per millimetre (which COLMAP leaves); None when EXIF tells neither."""
    equivalent_mm = _number(exif, FOCAL_LENGTH_35MM)
    if equivalent_mm > 0:
        focal_px = equivalent_mm / DIAGONAL_35MM * math.hypot(width, height)
    else:
        unit_mm = UNIT_MM.get(int(_number(exif, FOCAL_PLANE_UNIT)), UNIT_MM[2])
        shrunk = max(width, height) / (_number(exif, PIXELS_ACROSS) or max(width, height))
        focal_px = _number(exif, FOCAL_LENGTH) * _number(exif, FOCAL_PLANE_RESOLUTION) / unit_mm * shrunk
    return focal_px if is_plausible(focal_px, width, height) else None


def is_plausible(focal_px: float, width: int, height: int) -> bool:
    """True if a focal length in pixels is plausible for a picture of this size."""
    low, high = (share * max(width, height) for share in PLAUSIBLE)
    return low < focal_px < high


def _number(exif: Exif, tag: int) -> float:
    """A tag's value; 0 where it is missing or no number."""
    try:
        value = float(exif.get(tag, 0))
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return value if math.isfinite(value) else 0.0
