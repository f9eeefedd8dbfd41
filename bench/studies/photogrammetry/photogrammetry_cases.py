"""Cases of the study of photogrammetry: the hands that are rendered, and the conditions that are
varied."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import parse

SPECKLE = {"speckle": 0.7, "texture_contrast": 1.0}
# Several millimetres of depth of field, an f-number of a hand-held camera, skin that shines.
REAL = {
    "f_number": 11.0,
    "highlights": 1.0,
    "roughness": 0.25,
    "exposure_spread": 0.15,
    "white_balance_spread": 0.05,
    "motion_px": 0.7,
}


PLACED = {"distance_m": 0.31, "offset_m": (0.0, -0.03)}  # handbench's hands and those of files


@dataclass(frozen=True)
class PhotogrammetryCase:
    """A hand in a pose, its photographs, and how they are reconstructed.

    pose: a letter of the manual alphabet, or a mesh file in metres in the frame of handbench's
    hands. cameras, width: number of photographs, and their width in pixels. quality: of the depth
    maps. known: True if the intrinsics are given. photos: further settings of the rendering.
    """

    name: str
    pose: str
    seed: int
    cameras: int = 8
    width: int = 3000
    quality: str = "normal"
    known: bool = True
    photos: dict[str, Any] = field(default_factory=dict)

    @property
    def is_file(self) -> bool:
        """True if the hand is from a mesh file."""
        return self.pose.endswith((".ply", ".obj", ".stl"))

    def scene_file(self) -> SceneFile:
        """Return the scene to render: a hand of skin on the stand, with photographs in the format
        3:2."""
        photos = {
            "cameras": self.cameras,
            "width": self.width,
            "height": self.width * 2 // 3,
            **self.photos,
        }
        hand = (
            {"kind": "mesh", "path": Path(self.pose).name}
            if self.is_file
            else {"kind": "hand", "pose": self.pose}
        )
        target = {**PLACED, **hand, "material": {"kind": "skin"}}
        values = {
            "version": 1,
            "name": self.name,
            "seed": self.seed,
            "target": target,
            "photos": photos,
        }
        return parse(SceneFile, values, f"case '{self.name}'")


def bars(poses: tuple[str, ...]) -> Iterator[PhotogrammetryCase]:
    """Yield the cases that measure accuracy: for each pose, several numbers of photographs, and
    easy and difficult conditions such as unknown intrinsics, defocus or weak texture."""
    for seed, pose in enumerate(poses, start=201):
        yield PhotogrammetryCase("8 views", pose, seed)
        yield PhotogrammetryCase("5 views, speckle", pose, seed, cameras=5, photos=SPECKLE)
        yield PhotogrammetryCase("5 views", pose, seed, cameras=5)
        yield PhotogrammetryCase("5 views, unknown intrinsics", pose, seed, cameras=5, known=False)
        yield PhotogrammetryCase("8 views, shine, focus, motion, exposure", pose, seed, photos=REAL)
        yield PhotogrammetryCase(
            "8 views, contrast 0.3", pose, seed, photos={"texture_contrast": 0.3}
        )


def sweep(pose: str, seed: int = 301) -> Iterator[PhotogrammetryCase]:
    """Yield the cases that measure accuracy against time: all combinations of number of
    photographs, image size and quality on one pose, without some that take minutes and add no
    information."""
    for cameras in (5, 8, 12):
        for width in (1500, 3000):
            for quality in ("draft", "normal", "high"):
                if quality == "high" and (cameras == 12 or (cameras, width) == (5, 3000)):
                    continue  # minutes each, and no other answer
                yield PhotogrammetryCase(
                    f"{cameras} × {width} px, {quality}", pose, seed, cameras, width, quality
                )
