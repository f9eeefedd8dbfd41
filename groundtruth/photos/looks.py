"""Checks of photographs before the work: repeated, blurred and untextured ones."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundtruth.photos.photos import FEWEST, Photo
from radar.support.errors import HandbenchError
from radar.support.files import content_hash
from radar.support.progress import say, track

LOOK_PX = 1000  # longer side at which photographs are looked at
DIRECTIONS = 8
FEWEST_FEATURES = 40  # of a photograph that may register
BLURRED = 0.5  # sharpness, against the median's: a blur of about 1.2 px (standard deviation) at LOOK_PX


@dataclass(frozen=True)
class Look:
    """Measures of one photograph: hash of its pixels, sharpness, number of features (or of enough of them)."""

    pixels: str
    sharpness: float
    features: int


def usable(photos: tuple[Photo, ...]) -> tuple[Photo, ...]:
    """The photographs without repetitions and without those that are blurred against the others; says which are left
    out. A HandbenchError when fewer than three differ or show any texture."""
    looks = {photo.name: look_at(photo) for photo in track(photos, "looking")}
    first = {look.pixels: name for name, look in reversed(looks.items())}
    for name, look in looks.items():
        if first[look.pixels] != name:
            say(f"{name}: the same pixels as {first[look.pixels]}; left out")
    photos = tuple(photo for photo in photos if first[looks[photo.name].pixels] == photo.name)
    folder = photos[0].path.parent
    if len(photos) < FEWEST:
        raise HandbenchError(f"{folder}: only {len(photos)} photographs differ; at least {FEWEST} are needed")
    textured = sum(looks[photo.name].features >= FEWEST_FEATURES for photo in photos)
    if textured < FEWEST:
        raise HandbenchError(
            f"{folder}: {textured} of {len(photos)} photographs show enough texture ({FEWEST_FEATURES} features), "
            f"{FEWEST} are needed; light the scene, focus, and put something printed with fine detail around the hand"
        )
    return _without_blurred(photos, looks)


def _without_blurred(photos: tuple[Photo, ...], looks: dict[str, Look]) -> tuple[Photo, ...]:
    typical = np.median([looks[photo.name].sharpness for photo in photos])
    blurred = [photo for photo in photos if looks[photo.name].sharpness < BLURRED * typical]
    spared = len(photos) - len(blurred) >= FEWEST
    for photo in blurred:
        share, what = looks[photo.name].sharpness / typical, "left out" if spared else "used, since there are few"
        say(f"{photo.name}: blurred ({share:.0%} of the others' sharpness); {what}")
    return tuple(photo for photo in photos if photo not in blurred) if spared else photos


def look_at(photo: Photo) -> Look:
    """Sharpness is the power of the picture's second derivative along a line over that of its first, in the direction
    where this is least: contrast and plain surfaces cancel, and a camera that moved along a line is noticed too."""
    gray = photo.gray()
    pixels = content_hash(gray)
    scale = LOOK_PX / max(gray.shape)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    angles_rad = np.linspace(0, np.pi, DIRECTIONS, endpoint=False)
    slopes = ((_slope(gray, angle_rad), angle_rad) for angle_rad in angles_rad)
    sharpness = min(float(_slope(slope, angle_rad).var() / max(slope.var(), 1e-12)) for slope, angle_rad in slopes)
    return Look(pixels, sharpness, _features((gray * 255).round().astype(np.uint8)))


def _features(gray: np.ndarray) -> int:
    """Number of features: of the middle quarter, if it has enough of them, since the whole takes four times as long."""
    h, w = gray.shape
    sift = cv2.SIFT_create()
    middle = len(sift.detect(gray[h // 4 : h - h // 4, w // 4 : w - w // 4], None))
    return middle if middle >= FEWEST_FEATURES else len(sift.detect(gray, None))


def _slope(picture: np.ndarray, angle_rad: float) -> np.ndarray:
    """Derivative [h, w] of a picture along a direction."""
    slope_y, slope_x = np.gradient(picture)
    return np.cos(angle_rad) * slope_x + np.sin(angle_rad) * slope_y
