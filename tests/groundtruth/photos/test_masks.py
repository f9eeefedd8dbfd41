"""Masks: from files and alpha channels, and what they leave of a view."""

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.dense.views import open_view
from handbench.groundtruth.photos.masks import ORIENTATION, read_mask
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError

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


@pytest.mark.parametrize("name", ["a.png.png", "a.png"])
def test_masks_are_found_under_both_names(tmp_path, name):
    masks = write(tmp_path / "masks", name, DISC * 3)  # any nonzero number
    assert np.array_equal(read_mask(photo_of(tmp_path), masks), DISC)


def test_an_alpha_channel_is_a_mask(tmp_path):
    assert read_mask(photo_of(tmp_path), None).all()
    photo = photo_of(tmp_path, LEFT)
    assert np.array_equal(read_mask(photo, None), LEFT)
    masks = write(tmp_path / "masks", "a.png", DISC)
    assert np.array_equal(read_mask(photo, masks), LEFT & DISC)


@pytest.mark.parametrize(
    ("name", "mask", "alpha", "words"),
    [
        ("a.png", DISC[::2, ::2], None, r"a mask of 120 × 80 pixels, but a\.png has 240 × 160"),
        ("a.png", np.rot90(DISC)[1:], None, r"a mask of 160 × 239 pixels"),
        ("a.png", 0 * DISC, None, r"masks.a\.png: is a mask that is zero everywhere"),
        ("a.png", ~LEFT, LEFT, "zero everywhere"),
        ("b.png", DISC, None, r"no mask for a\.png; add a\.png\.png or a\.png"),
    ],
)
def test_masks_that_do_not_fit_are_refused(tmp_path, name, mask, alpha, words):
    masks = write(tmp_path / "masks", name, mask)
    with pytest.raises(HandbenchError, match=words):
        read_mask(photo_of(tmp_path, alpha), masks)


@pytest.mark.parametrize(("orientation", "turns"), [(6, 3), (8, 1)])
def test_a_mask_of_the_upright_picture_is_turned(tmp_path, orientation, turns):
    photo = photo_of(tmp_path, orientation=orientation)
    for mask in (np.rot90(DISC, turns), DISC):  # 90° clockwise for 6; of the stored pixels
        masks = write(tmp_path / "masks", "a.png", mask)
        assert np.array_equal(read_mask(photo, masks), DISC)


def test_a_view_is_unknown_outside_the_mask(tmp_path):
    colmap, photo = load_pycolmap(), photo_of(tmp_path)
    camera = colmap.Camera(model="PINHOLE", width=WIDTH, height=HEIGHT, params=[240, 240, 120, 80])
    pose = colmap.Rigid3d()
    for shrink in (1, 2):
        view = open_view(photo, camera, pose, shrink, (0.5, 2.0), None, DISC)
        inside = DISC[shrink // 2 :: shrink, shrink // 2 :: shrink]
        assert np.array_equal(np.isfinite(view.near_m), inside) and np.array_equal(
            np.isfinite(view.far_m), inside
        )
        assert (view.near_m[inside] == 0.5).all()
    assert open_view(photo, camera, pose, 1, (0.5, 2.0), None, np.zeros_like(DISC)) is None
