"""EXIF data of a camera: focal length, body, and the orientation of the picture."""

import numpy as np
import pytest
from PIL import Image, ImageOps

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import Photo, focal_length_px, read_exif, stored_picture

WIDTH, HEIGHT = 32, 24
FOCAL_MM, FOCAL_35_MM, ORIENTATION = 0x920A, 0xA405, 0x0112
RESOLUTION, UNIT, FULL_WIDTH = 0xA20E, 0xA210, 0xA002


def colmaps_camera(folder, name):
    """The camera of a photograph as COLMAP reads it."""
    colmap = load_pycolmap()
    colmap.Database.open(folder / "database.db").close()
    colmap.import_images(folder / "database.db", folder, colmap.CameraMode.AUTO, [name])
    with colmap.Database.open(folder / "database.db") as stored:
        return stored.read_all_cameras()[0]


def test_an_equivalent_focal_length_is_colmaps(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[FOCAL_35_MM] = 26
    Image.new("L", (WIDTH, HEIGHT)).save(tmp_path / "a.jpg", exif=exif)
    focal_px = focal_length_px(read_exif(tmp_path / "a.jpg"), WIDTH, HEIGHT)
    assert focal_px == pytest.approx(colmaps_camera(tmp_path, "a.jpg").focal_length, rel=3e-4)


@pytest.mark.parametrize(
    ("tags", "focal_px"),
    [
        ({FOCAL_MM: 3.5, RESOLUTION: 100.0, UNIT: 3}, 35),  # 100 pixels a centimetre
        ({FOCAL_MM: 3.5, RESOLUTION: 10.0, UNIT: 4}, 35),  # a millimetre
        ({FOCAL_MM: 2.54, RESOLUTION: 5000.0, UNIT: 2, FULL_WIDTH: 320}, 50),  # shrunk by ten
        ({FOCAL_MM: 35.0}, None),
        ({FOCAL_35_MM: "26 mm", FOCAL_MM: float("inf")}, None),
    ],
)
def test_a_focal_length_in_pixels_of_the_focal_plane(tags, focal_px):
    found_px = focal_length_px(tags, WIDTH, HEIGHT)
    assert found_px == (focal_px and pytest.approx(focal_px, rel=1e-3))


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_an_upright_picture_is_turned_to_the_stored_one(tmp_path, orientation):
    stored = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(stored).save(tmp_path / "a.png", exif=exif)
    with Image.open(tmp_path / "a.png") as image:
        upright = np.asarray(ImageOps.exif_transpose(image))
    photo = Photo(tmp_path / "a.png", "a.png", WIDTH, HEIGHT, orientation=orientation)
    np.testing.assert_array_equal(stored_picture(photo, upright), stored)
