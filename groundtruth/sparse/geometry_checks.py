"""Reconstructions that carry no depth, refused before the dense stage."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from groundtruth.cameras.cameras import registered
from groundtruth.photos.photos import Photo
from radar.support.errors import HandbenchError
from radar.support.progress import say

if TYPE_CHECKING:
    import pycolmap

SMALLEST_BASELINE = 0.03  # distance between cameras over distance to the scene


def unregistered(photos: tuple[Photo, ...], model: pycolmap.Reconstruction) -> tuple[str, ...]:
    """Names of the photographs that are not part of a reconstruction; said aloud."""
    known = {image.name for image in registered(model)}
    names = tuple(photo.name for photo in photos if photo.name not in known)
    if names:
        say(f"not registered, and not used: {', '.join(names)} (too little overlap with the others, or another scene)")
    return names


def check_geometry(model: pycolmap.Reconstruction) -> None:
    """A HandbenchError when the cameras hardly moved, against the distance of what they see: such photographs register,
    and carry no depth."""
    images = [image for image in registered(model) if image.num_points3D]
    centres = np.array([image.projection_center() for image in images])
    reach = [np.linalg.norm(centres - image.projection_center(), axis=1).max() for image in images]
    moved = np.median([far / _depth(image, model) for far, image in zip(reach, images, strict=True)] or [0])
    if moved < SMALLEST_BASELINE:
        raise HandbenchError(
            f"photographs: the cameras moved by {moved:.2%} of the distance to the scene only, {SMALLEST_BASELINE:.0%} "
            "are needed; turning a camera on the spot shows no depth: take the photographs from different places, 10° "
            "to 30° apart"
        )


def _depth(image: pycolmap.Image, model: pycolmap.Reconstruction) -> float:
    """Median distance of the points that a photograph sees."""
    points = np.array([model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()])
    return float(np.median(np.linalg.norm(points - image.projection_center(), axis=1)))
