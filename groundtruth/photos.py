"""Photographs on disk: search, tones, detection of repeated and blurred ones, and masks of the
target's pixels, from files and from alpha channels.

Pixels are used as the sensor stored them, without the rotation in EXIF data, as in COLMAP: then all
photographs of a sensor share intrinsics, and a rotated camera has only another pose.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from handbench.groundtruth.pictures import (
    ORIENTATION,
    PLAIN,
    RAW,
    SUFFIXES,
    UNREAD,
    is_deep,
    open_picture,
)
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, one_form, require_folder
from handbench.support.progress import say, track

FEWEST = 3
DARK, BRIGHT = 0.01, 0.99  # quantiles of a photograph's tones that stretching makes black and white
LEAST_CONTRAST = 0.4  # between them; a photograph with less is stretched
SMALLEST_PX, FLATTEST = 8, 0.02  # least shorter side, also relative to the longer one
STEP = 1 / 255  # between two tones of 8 bits
SAMPLED = 7  # of so many pixels, one is enough for the quantiles
QUALITY_PX = 1000  # longer side at which sharpness is measured
BLURRED = 0.6  # sharpness against the median's; sharp photographs are within 0.9 to 1.1
# ORIENTATION's value → quarter turns from the upright to the stored picture
TURNS = {6: 1, 8: 3}


@dataclass(frozen=True)
class Photo:
    """One photograph: its file, name, size in pixels as stored, and tones.

    tones: gray values in the file, 0 … 1, that are black and white in the reconstruction.
    """

    path: Path
    name: str
    width: int
    height: int
    tones: tuple[float, float] = (0.0, 1.0)

    @property
    def stretched(self) -> bool:
        """True if the tones are not those of the file."""
        return self.tones != (0, 1)

    @property
    def plain(self) -> bool:
        """True if COLMAP reads the same gray values from the file."""
        return not self.stretched and self.path.suffix.lower() in PLAIN

    def gray(self) -> np.ndarray:
        """Read the stretched gray values [height, width], float32 in 0 … 1."""
        return self.stretch(read_gray(self.path))

    def stretch(self, gray: np.ndarray) -> np.ndarray:
        """Stretch gray values in 0 … 1 of the file."""
        black, white = self.tones
        return ((gray - black) / (white - black)).clip(0, 1)

    def save_copy(self, path: Path) -> None:
        """Write the gray values as a PNG file of any name, with the EXIF data of the photograph."""
        with open_picture(self.path) as image:
            exif = image.info.get("exif", b"")
        gray = (self.gray() * 255).round().astype(np.uint8)
        Image.fromarray(gray).save(path, format="PNG", exif=exif)


def find_photos(folder: str | Path) -> tuple[Photo, ...]:
    """Find the photographs at `photo_paths(folder)`.

    Each photograph is decoded once, so that a broken file is reported before any work starts.
    Raises HandbenchError for a broken file, and if there are fewer than three photographs.
    """
    return tuple(_open(path) for path in photo_paths(folder))


def photo_paths(folder: str | Path) -> list[Path]:
    """List the photographs in `folder` or, if it has none, in `folder/images`, sorted by name. Of a
    RAW file and another one of the same name, the other one is used. Raises HandbenchError if there
    are fewer than three."""
    folder = require_folder(folder, "photographs")
    paths = _pictures(folder) or _pictures(folder / "images")
    if len(paths) < FEWEST:
        raise HandbenchError(
            f"{folder}: found only {len(paths)} photographs ({', '.join(SUFFIXES)}) in it and in "
            f"images/; expected at least {FEWEST}; 5 to 12 from different sides are good"
        )
    return paths


def read_gray(path: Path) -> np.ndarray:
    """Read a picture file as gray values [height, width], float32 in 0 … 1.

    The picture may be gray, in colours, with a palette or CMYK, with 8 or 16 bits a channel.
    """
    import cv2

    with open_picture(path) as image:
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


def read_alpha(path: Path) -> np.ndarray:
    """Read which pixels [height, width] of a picture file are not transparent: True at those whose
    alpha is not zero, and at all of a file without alpha channel."""
    with open_picture(path) as image:
        if not image.has_transparency_data:
            return np.ones((image.height, image.width), dtype=bool)
        return np.asarray(image.convert("RGBA").getchannel("A")) > 0


def _pictures(folder: Path) -> list[Path]:
    """List the pictures in a folder, sorted by name; empty if the folder does not exist."""
    paths = [path for path in folder.glob("[!.]*") if path.suffix.lower() in SUFFIXES + UNREAD]
    developed = {path.stem for path in paths if path.suffix.lower() not in RAW}
    return sorted(p for p in paths if p.suffix.lower() not in RAW or p.stem not in developed)


def _open(path: Path) -> Photo:
    gray, opaque = read_gray(path), read_alpha(path)
    height, width = gray.shape
    if min(gray.shape) < max(SMALLEST_PX, FLATTEST * max(gray.shape)):
        raise HandbenchError(f"{path}: has only {width} × {height} pixels; remove it")
    seen = gray[opaque]
    tones = (0.0, 1.0)
    if seen.size:
        black, white = np.quantile(seen[::SAMPLED], (DARK, BRIGHT)).tolist()
        if white - black < LEAST_CONTRAST:
            tones = (black, max(white, black + STEP))
    return Photo(path, one_form(path.name), width, height, tones)


def select_usable(photos: tuple[Photo, ...]) -> tuple[Photo, ...]:
    """Return the photographs without duplicates and without those that are blurred compared with
    the others.

    Removed and stretched photographs are reported. Blurred ones are kept if fewer than three would
    be left. Raises HandbenchError if fewer than three photographs differ.
    """
    sharpness: dict[Photo, float] = {}
    first: dict[str, str] = {}  # content → name
    for photo in track(photos, "looking"):
        gray = photo.gray()
        name = first.setdefault(content_hash(gray), photo.name)
        if name == photo.name:
            sharpness[photo] = sharpness_of(gray)
        else:
            say(f"{photo.name}: has the same pixels as {name}, so it is left out")
    if len(sharpness) < FEWEST:
        raise HandbenchError(
            f"{photos[0].path.parent}: different photographs: {len(sharpness)} of {len(photos)}; "
            f"expected at least {FEWEST}; take more, from different sides"
        )
    typical = np.median([*sharpness.values()])
    blurred = [photo for photo in sharpness if sharpness[photo] < BLURRED * typical]
    enough_remain = len(sharpness) - len(blurred) >= FEWEST
    action = "left out" if enough_remain else "used, because there are only a few photographs"
    for photo in blurred:
        say(
            f"{photo.name}: is blurred ({sharpness[photo] / typical:.0%} of the typical "
            f"sharpness); {action}"
        )
    usable = tuple(photo for photo in sharpness if not (enough_remain and photo in blurred))
    if stretched := [photo.name for photo in usable if photo.stretched]:
        say(f"dark or bright photographs, whose tones are stretched: {', '.join(stretched)}")
    return usable


def sharpness_of(gray: np.ndarray) -> float:
    """Measure the sharpness of a picture [height, width], a ratio without unit that is comparable
    between photographs of one scene: the power of its second derivatives over that of its first. It
    does not depend on contrast or plain areas."""
    import cv2

    scale = min(1, QUALITY_PX / max(gray.shape))
    gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    slopes = np.square(np.gradient(gray)).sum(axis=0)
    return float(cv2.Laplacian(gray, cv2.CV_32F).var() / max(slopes.mean(), 1e-12))


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
