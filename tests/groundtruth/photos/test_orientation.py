"""Masks and cameras of upright pictures, carried to the stored pixels."""

import numpy as np
import pytest
from PIL import Image, ImageOps
from scipy.spatial.transform import Rotation

from handbench.groundtruth.cameras.camera_files import stored_camera
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.photos.photos import Photo, sides_swapped, stored_picture
from handbench.support.errors import HandbenchError

WIDTH, HEIGHT = 32, 24  # as stored


def photograph(tmp_path, orientation):
    """A stored picture [24, 32] on disk, and the same as a viewer shows it."""
    stored = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.png"
    Image.fromarray(stored).save(path, exif=exif)
    with Image.open(path) as image:
        upright = np.asarray(ImageOps.exif_transpose(image))
    return Photo(path, path.name, WIDTH, HEIGHT, orientation=orientation), stored, upright


@pytest.mark.parametrize("orientation", [3, 6, 8])
@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("SIMPLE_RADIAL", (40.0, 13.0, 15.0, -0.05)),
        ("FULL_OPENCV", (40.0, 42.0, 13.0, 15.0, -0.05, 0.02, 3e-3, -2e-3, 1e-3, 0, 0, 0)),
        ("OPENCV_FISHEYE", (40.0, 42.0, 13.0, 15.0, -0.05, 0.02, 0.01, 0.003)),
    ],
)
def test_an_upright_camera_sees_the_same_pixel_of_the_stored_picture(
    tmp_path, orientation, model, params
):
    photo, stored, upright = photograph(tmp_path, orientation)
    assert np.array_equal(stored_picture(photo, upright), stored)
    height, width = upright.shape
    assert sides_swapped(photo, width, height) == (orientation in (6, 8))
    assert not sides_swapped(photo, WIDTH, HEIGHT)
    pose = {
        "R": Rotation.from_euler("xyz", (20, -10, 30), degrees=True).as_matrix().tolist(),
        "t": (0.1, 0.2, 1.0),
    }
    camera = Camera(name="a.png", width=width, height=height, model=model, params=params, **pose)
    turned = stored_camera(photo, camera)
    assert (turned.width, turned.height) == (WIDTH, HEIGHT)
    np.testing.assert_allclose(turned.centre_m, camera.centre_m, atol=1e-12)
    points_m = np.random.default_rng(1).uniform(-0.1, 0.1, (200, 3))
    there, here = (np.floor(c.project(points_m)).astype(int) for c in (camera, turned))
    inside = ((here >= 0) & (here < (WIDTH, HEIGHT))).all(axis=1)
    assert inside.sum() > 50
    assert np.array_equal(
        upright[there[inside, 1], there[inside, 0]], stored[here[inside, 1], here[inside, 0]]
    )


def test_a_lens_that_is_not_the_same_when_turned_is_refused(tmp_path):
    photo, *_ = photograph(tmp_path, 6)
    params = (40.0, 40.0, 12.0, 16.0, *8 * (0.0,))
    camera = Camera(name="a.png", width=24, height=32, model="THIN_PRISM_FISHEYE", params=params)
    with pytest.raises(
        HandbenchError,
        match=r"a\.png: is calibrated for the upright.*THIN_PRISM_FISHEYE cannot be rotated",
    ):
        stored_camera(photo, camera)
