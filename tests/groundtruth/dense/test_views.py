"""Pictures that are prepared for matching."""

import cv2
import numpy as np

from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.dense.views import open_view
from handbench.groundtruth.photos import Photo

SIDE = 200


def test_interpolation_does_not_take_the_noise_away(tmp_path):
    """Half-way between two pixels white noise has half of its variance; after a blur of half a
    pixel, whose weights are 0.107, 0.787, 0.107, it has (1 + 0.26) / 2 = 0.63. The noise of 40,000
    pixels knows that to 0.01."""
    noise = np.random.default_rng(1).normal(128, 20, (SIDE, SIDE)).clip(0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), noise)
    colmap = load_pycolmap()
    camera = colmap.Camera(
        model="PINHOLE", width=SIDE, height=SIDE, params=[SIDE, SIDE, SIDE / 2, SIDE / 2]
    )
    photo = Photo(tmp_path / "a.png", "a.png", SIDE, SIDE)
    gray = open_view(photo, camera, colmap.Rigid3d(), 1, (0.5, 2.0), None, noise < 256).gray
    between = (gray[:, 1:] + gray[:, :-1]) / 2
    assert 0.6 < between.var() / gray.var() < 0.7
