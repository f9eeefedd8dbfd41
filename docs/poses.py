"""Draw the README's figure of the benchmark's hands: python docs/poses.py docs/poses.png

Each hand is photographed from the position of the array, in the light of its scene, by a camera
without lens errors.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from handbench.bench.run.benchmark_file import EMBEDDED
from handbench.bench.scenes.build import load_scene
from handbench.bench.scenes.photographs import Studio
from handbench.groundtruth.cameras.cameras import Camera
from handbench.support.files import atomic_path

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 440, 500, 560
CAMERA_FROM_RADAR = np.diag([-1.0, -1.0, 1.0])  # x grows to the left, as for whoever looks along +z


def portrait(letter: str) -> np.ndarray:
    """Return a picture [height, width, 3], 8-bit BGR, of the hand in the scene file of a letter, as
    seen from the array."""
    scene = load_scene(EMBEDDED / f"hand_{letter}.toml")
    rotation = CAMERA_FROM_RADAR @ scene.radar_from_photo.rotation
    eye_m = scene.radar_from_photo.inverse().points(np.array([0.0, 0.0, -0.29]))
    camera = Camera(
        name=f"{letter}.jpg",
        width=2 * WIDTH_PX,
        height=2 * HEIGHT_PX,
        params=(2 * 2 * FOCAL_PX, 2 * 2 * FOCAL_PX, WIDTH_PX, HEIGHT_PX, 0, 0, 0, 0),
        R=tuple(map(tuple, rotation.tolist())),
        t=tuple((-rotation @ eye_m).tolist()),
    )
    large = Studio(scene).photograph(camera, 0)
    return cv2.resize(large, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)


def main(out: str) -> None:
    """Draw the hands B, F and U next to each other and write the picture to `out`."""
    panels = []
    for letter in "bfu":
        panel = portrait(letter)
        cv2.rectangle(panel, (0, 0), (46, 46), (30, 30, 30), cv2.FILLED)
        cv2.putText(
            panel,
            letter.upper(),
            (11, 35),
            cv2.FONT_HERSHEY_SIMPLEX,
            1.1,
            (240, 240, 240),
            2,
            cv2.LINE_AA,
        )
        panels.append(panel)
    with atomic_path(Path(out)) as temporary:
        cv2.imwrite(str(temporary), np.hstack(panels), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main(*sys.argv[1:])
