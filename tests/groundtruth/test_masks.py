"""Masks: from files and alpha channels, and what they leave of a view."""

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.dense.views import open_view
from handbench.groundtruth.photos import ORIENTATION, Photo, read_mask
from tests.refusals import refuse

WIDTH, HEIGHT = 240, 160
DISC = np.hypot(*np.meshgrid(np.arange(WIDTH) - 130, np.arange(HEIGHT) - 80)) < 45
LEFT = np.arange(WIDTH) < 130 + np.zeros((HEIGHT, 1))


def photo_of(folder, alpha=None, orientation=1):
    picture = Image.fromarray(
        np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    )
    if alpha is not None:
        picture.putalpha(Image.fromarray(alpha.astype(np.uint8)))
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    picture.save(folder / "a.png", exif=exif)
    return Photo(folder / "a.png", "a.png", WIDTH, HEIGHT)


def write(folder, name, mask):
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / name), mask.astype(np.uint8))
    return folder


@pytest.mark.parametrize(
    ("name", "mask", "alpha", "orientation", "expected"),
    [
        ("a.png.png", DISC * 3, None, 1, DISC),  # any nonzero number
        ("a.png", DISC, LEFT, 1, LEFT & DISC),
        ("a.png", np.rot90(DISC, 3), None, 6, DISC),  # of the upright picture, 90° clockwise
        ("a.png", np.rot90(DISC, 1), None, 8, DISC),
        ("a.png", DISC, None, 6, DISC),  # of the stored pixels
    ],
)
def test_masks_are_found_and_turned(tmp_path, name, mask, alpha, orientation, expected):
    photo = photo_of(tmp_path, alpha, orientation)
    assert np.array_equal(read_mask(photo, write(tmp_path / "masks", name, mask)), expected)
    assert np.array_equal(read_mask(photo, None), np.ones_like(DISC) if alpha is None else alpha)


@pytest.mark.parametrize(
    ("name", "mask", "alpha", "places"),
    [
        ("a.png", DISC[::2, ::2], None, ("masks/a.png", "120 × 80")),
        ("a.png", np.rot90(DISC)[1:], None, ("masks/a.png", "160 × 239")),
        ("a.png", ~LEFT, LEFT, ("masks/a.png", "zero")),
        ("b.png", DISC, None, ("masks", "a.png")),
    ],
)
def test_masks_that_do_not_fit_are_refused(tmp_path, name, mask, alpha, places):
    masks = write(tmp_path / "masks", name, mask)
    refuse(lambda: read_mask(photo_of(tmp_path, alpha), masks), *places)


@pytest.mark.parametrize("shrink", [1, 2])
def test_a_view_is_unknown_outside_the_mask(tmp_path, shrink):
    colmap, photo = load_pycolmap(), photo_of(tmp_path)
    camera = colmap.Camera(model="PINHOLE", width=WIDTH, height=HEIGHT, params=[240, 240, 120, 80])
    seen = (photo, camera, colmap.Rigid3d(), shrink, (0.5, 2.0), None)
    view, inside = open_view(*seen, DISC), DISC[shrink // 2 :: shrink, shrink // 2 :: shrink]
    for limit_m, expected_m in ((view.near_m, 0.5), (view.far_m, 2.0)):
        assert np.array_equal(np.isfinite(limit_m), inside)
        assert (limit_m[inside] == expected_m).all()
    assert open_view(*seen, np.zeros_like(DISC)) is None
