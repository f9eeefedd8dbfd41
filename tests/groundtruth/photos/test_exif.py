"""The focal length in EXIF data."""

import pytest
from PIL import Image

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import focal_length_px, read_exif

WIDTH, HEIGHT = 32, 24
FOCAL_MM, FOCAL_35_MM = 0x920A, 0xA405
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
