"""Masks: from files, and what they leave of a view."""

import cv2
import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.dense.views import open_view
from handbench.groundtruth.photos.masks import find_masks, read_mask
from handbench.groundtruth.photos.photos import Photo
from handbench.support.errors import HandbenchError

WIDTH, HEIGHT = 240, 160
DISC = np.hypot(*np.meshgrid(np.arange(WIDTH) - 130, np.arange(HEIGHT) - 80)) < 45


@pytest.fixture
def photo(tmp_path):
    picture = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    return Photo(tmp_path / "a.png", "a.png", WIDTH, HEIGHT)


@pytest.fixture
def camera():
    return load_pycolmap().Camera(
        model="PINHOLE", width=WIDTH, height=HEIGHT, params=[240, 240, 120, 80]
    )


def write(folder, name, mask):
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / name), mask.astype(np.uint8))


@pytest.mark.parametrize("name", ["a.png.png", "a.png"])
def test_masks_are_found_under_both_names(tmp_path, photo, name):
    write(tmp_path / "masks", name, DISC * 3)  # any nonzero number
    files = find_masks(tmp_path / "masks", (photo,))
    assert np.array_equal(read_mask(files["a.png"], photo), DISC)


def test_masks_that_do_not_fit_are_refused(tmp_path, photo):
    for mask, words in (
        (DISC[::2, ::2], r"is a mask of 120 × 80 pixels, but a\.png has 240 × 160"),
        (np.zeros_like(DISC), "is zero everywhere"),
    ):
        write(tmp_path / "masks", "a.png", mask)
        with pytest.raises(HandbenchError, match=words):
            find_masks(tmp_path / "masks", (photo,))
    other = Photo(tmp_path / "b.jpg", "b.jpg", 4, 4)
    with pytest.raises(HandbenchError, match=r"no mask for b\.jpg; add b\.jpg\.png or b\.png"):
        find_masks(tmp_path / "masks", (photo, other))


@pytest.mark.parametrize(("orientation", "turns"), [(6, 3), (8, 1)])
def test_a_mask_of_the_upright_picture_is_turned(tmp_path, photo, orientation, turns):
    turned = Photo(photo.path, photo.name, WIDTH, HEIGHT, orientation=orientation)
    for mask in (np.rot90(DISC, turns), DISC):  # 90° clockwise for 6; of the stored pixels
        write(tmp_path / "masks", "a.png", mask)
        assert np.array_equal(read_mask(tmp_path / "masks" / "a.png", turned), DISC)


def test_a_view_is_unknown_outside_the_mask(photo, camera):
    pose = load_pycolmap().Rigid3d()
    for shrink in (1, 2):
        view = open_view(photo, camera, pose, shrink, (0.5, 2.0), None, DISC)
        inside = DISC[shrink // 2 :: shrink, shrink // 2 :: shrink]
        assert np.array_equal(np.isfinite(view.near_m), inside) and np.array_equal(
            np.isfinite(view.far_m), inside
        )
        assert (view.near_m[inside] == 0.5).all()
    assert open_view(photo, camera, pose, 1, (0.5, 2.0), None, np.zeros_like(DISC)) is None
