"""Reading of untrusted picture files: the header is compared with the size of the file before any
pixel is decoded."""

import io
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes
from handbench.support.limits import PICTURE_BYTES

FORMATS = ["JPEG", "PNG", "TIFF"]  # of what else Pillow knows, some starts programs
LARGEST_PX = 110_000_000  # a hundred megapixels take a GB to decode
SMALL_PX = 24_000_000  # half a second: what few bytes may hold, up to ...
PACKED_PX = 10_000  # ... so many pixels in one: a blank mask of one bit a pixel has 8000
# in a byte of a larger picture (deflate's most), and of one with 16 bits a channel
DENSE_PX, DENSE_DEEP_PX = (1100, 4)
# of a progressive JPEG, each of which goes over all pixels; programs write about ten
MOST_SCANS = 32
MOST_MARKERS = 10_000  # of a JPEG; programs write some dozens
MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]", re.DOTALL)  # that ends a scan


READ = (".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff")
HEIC = (".heic", ".heif")
try:
    import pillow_heif  # an extra
except ImportError:
    SUFFIXES: tuple[str, ...] = READ
else:
    pillow_heif.register_heif_opener()
    FORMATS.append("HEIF")
    SUFFIXES = (*READ, *HEIC)


@contextmanager
def open_picture(path: Path) -> Iterator[Image.Image]:
    """Context manager that yields a picture file, opened but not yet decoded.
    Raises HandbenchError if the file cannot be opened or decoded, also if decoding fails in the
    block, and if its header claims so many pixels that decoding would take too long or too much
    memory."""
    # a file takes memory for what it says it has
    content = io.BytesIO(read_bytes(path, "a photograph", PICTURE_BYTES))
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(content, formats=FORMATS) as image,
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
        unknown = f"no {', '.join(FORMATS)} inside{_inside(content.getvalue())}"
        reason = unknown if isinstance(error, UnidentifiedImageError) else error
        raise HandbenchError(
            f"{path}: is not a readable photograph ({reason}); replace or remove it"
        ) from error


def _inside(content: bytes) -> str:
    """Return words for a message if a file's content is HEIC or AVIF, such as ", but HEIC"; ""
    otherwise. Telephones store such pictures under the names of JPEG files."""
    brand = content[8:12].decode("latin-1").upper() if content[4:8] == b"ftyp" else ""
    return f", but {brand}" if brand.isalnum() else ""


def is_deep(image: Image.Image) -> bool:
    """Tell whether a picture has 16 bits per channel, even if Pillow would read it with 8."""
    return ";16" in str(getattr(image, "tile", ""))


def _require_plausible(image: Image.Image, content: bytes) -> None:
    pixels, size = image.width * image.height, len(content)
    dense_px = (
        DENSE_DEEP_PX if is_deep(image) else DENSE_PX * (8 if image.mode == "1" else 1)
    ) * size
    if pixels > min(
        LARGEST_PX, PACKED_PX * size, max(SMALL_PX // (1 + 2 * is_deep(image)), dense_px)
    ):
        dimensions = f"it has {image.width} × {image.height} pixels in {size} bytes"
        raise ValueError(
            f"{dimensions}, too many; at most {LARGEST_PX} pixels are read, and above {SMALL_PX} "
            f"pixels at most {dense_px // size} per byte"
        )
    if image.format in ("JPEG", "MPO") and (scans := _scans(content)) > MOST_SCANS:
        raise ValueError(
            f"it has {scans} scans, more than the limit of {MOST_SCANS}; save it again as a plain "
            "JPEG"
        )
    sides = [getattr(image, "tag_v2", {}).get(tag, 1) for tag in (322, 323)]  # TIFF's
    if not all(isinstance(side, int) for side in sides) or sides[0] * sides[1] > max(
        SMALL_PX, pixels
    ):
        raise ValueError(
            f"its tiles of {' × '.join(map(str, sides))} pixels are too large; save it again "
            "without tiles"
        )


def _scans(content: bytes) -> int:
    """Return the number of scans of a JPEG file, in each of which a decoder goes over all pixels.
    Counting stops soon after 32 scans (MOST_SCANS).
    content: the bytes of the file. Raises ValueError for too many markers."""
    count, at = 0, 2
    for _ in range(MOST_MARKERS):
        if not (found := MARKER.search(content, at)):
            break
        kind, start = content[found.end() - 1], found.end()
        if kind == 0xD9 or count > MOST_SCANS:
            break
        count += kind == 0xDA
        at = (
            start
            if kind in (0x01, 0xD8)
            else start + int.from_bytes(content[start : start + 2], "big")
        )
    else:
        raise ValueError(f"it has more than {MOST_MARKERS} JPEG markers; save it again")
    return count
