"""Reading of untrusted picture files: the header is compared with the size of the file before any
pixel is decoded."""

import io
import math
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from PIL import Image

from handbench.support.errors import HandbenchError
from handbench.support.files import PICTURE_BYTES, read_bytes

FORMATS = ["JPEG", "PNG", "TIFF"]  # of what else Pillow knows, some starts programs
LARGEST_PX = 110_000_000  # a hundred megapixels take a GB to decode
SMALL_PX = 24_000_000  # half a second, whatever the size of the file
DENSE_PX = 1100  # in a byte of a larger picture: deflate's most
# of a progressive JPEG, each of which goes over all pixels; programs write about ten
SCANS = 32


PLAIN = (".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff")
HEIC = (".heic", ".heif")
RAW = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef")
SRGB = (2.4, 12.92)  # its tone curve, as rawpy takes it
SUFFIXES = (*PLAIN, *HEIC, *RAW)
UNREAD = (".webp", ".bmp", ".gif", ".jp2", ".avif", ".jxl")  # refused, not passed over
ORIENTATION = 0x0112  # EXIF's tag


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Context manager that yields a picture file, opened but not yet decoded.
    Raises HandbenchError if the file cannot be opened or decoded, also if decoding fails in the
    block, if its header claims so many pixels that decoding would take too long or too much
    memory, and if it is a HEIC or RAW file whose package is not installed."""
    formats, suffix = FORMATS, path.suffix.lower()
    if suffix in HEIC:
        _package("pillow_heif", "heic", path).register_heif_opener()
        formats = [*FORMATS, "HEIF"]
    if suffix in RAW:
        yield _developed(path)
        return
    # a file takes memory for what it says it has
    content = io.BytesIO(read_bytes(path, "a photograph", PICTURE_BYTES))
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(content, formats=formats) as image,
        ):
            _require_plausible(image, content.getvalue())
            yield image
    except (
        OSError,
        SyntaxError,
        ValueError,
        TypeError,
        struct.error,
        Image.DecompressionBombError,
    ) as error:
        # Pillow adds the address of `content`
        reason = str(error).partition(" <")[0]
        raise HandbenchError(
            f"{path}: is not a readable {', '.join(formats)} ({reason}); replace or remove it"
        ) from error


def _package(module: str, extra: str, path: Path) -> Any:
    """Import the module that reads a picture file, which the extra of handbench installs."""
    try:
        return import_module(module)
    except ImportError as error:
        raise HandbenchError(
            f"{path}: cannot be read; run pip install 'handbench[{extra}]', or save it as JPEG, "
            "PNG or TIFF"
        ) from error


def _developed(path: Path) -> Image.Image:
    """Develop a RAW file in the camera's white balance, not rotated; its brightest 1 % are
    white."""
    rawpy = _package("rawpy", "raw", path)
    try:
        with rawpy.imread(io.BytesIO(read_bytes(path, "a photograph", PICTURE_BYTES))) as raw:
            if raw.sizes.raw_width * raw.sizes.raw_height > LARGEST_PX:
                raise OSError("too many pixels")
            return Image.fromarray(raw.postprocess(use_camera_wb=True, user_flip=0, gamma=SRGB))
    except (OSError, rawpy.LibRawError) as error:
        raise HandbenchError(f"{path}: is not a readable RAW file; replace or remove it") from error


def is_deep(image: Image.Image) -> bool:
    """Tell whether a picture has 16 bits per channel, even if Pillow would read it with 8."""
    return ";16" in str(getattr(image, "tile", ""))


def _require_plausible(image: Image.Image, content: bytes) -> None:
    """Raise ValueError for a picture that takes too much time or memory for its size."""
    pixels = image.width * image.height
    size = len(content)
    dense_px = DENSE_PX * (8 if image.mode == "1" else 1) * size
    if pixels > min(LARGEST_PX, max(SMALL_PX, dense_px)):
        raise ValueError(
            f"it has {image.width} × {image.height} pixels in {size} bytes, too many; at most "
            f"{LARGEST_PX} pixels are read, and above {SMALL_PX} pixels at most {DENSE_PX} per byte"
        )
    # these two bytes begin a scan, and are in other data once in 64 kB
    if image.format in ("JPEG", "MPO") and content.count(b"\xff\xda") > SCANS + size // 2**14:
        raise ValueError(f"it has more than {SCANS} scans; save it again as a plain JPEG")
    tile_px = math.prod(getattr(image, "tag_v2", {}).get(tag, 1) for tag in (322, 323))
    if tile_px > max(SMALL_PX, pixels):
        raise ValueError("its tiles are too large; save it again without tiles")
