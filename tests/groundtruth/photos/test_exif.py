"""EXIF data of a camera."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import body_of, focal_length_px, orientation_of, read_exif

WIDTH, HEIGHT = 320, 240


def photograph(path, **tags):
    """A picture with the given EXIF tags (f: focal length in mm, f35: its equivalent on 35 mm film,
    …)."""
    number = {"f": 0x920A, "f35": 0xA405, "resolution": 0xA20E, "unit": 0xA210, "across": 0xA002}
    exif = Image.Exif()
    exif[0x0110] = "Camera"
    exif.get_ifd(0x8769).update({number[name]: value for name, value in tags.items()})
    Image.fromarray(
        np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    ).save(path, exif=exif)
    return read_exif(path)


def colmaps_camera(folder, name):
    """The camera of a photograph as COLMAP reads it."""
    colmap = load_pycolmap()
    colmap.Database.open(folder / "database.db").close()
    colmap.import_images(folder / "database.db", folder, colmap.CameraMode.AUTO, [name])
    with colmap.Database.open(folder / "database.db") as stored:
        return stored.read_all_cameras()[0]


def test_an_equivalent_focal_length_is_colmaps_first_guess(tmp_path):
    exif = photograph(tmp_path / "a.jpg", f=4.2, f35=26)
    camera = colmaps_camera(tmp_path, "a.jpg")
    assert camera.has_prior_focal_length
    assert focal_length_px(exif, WIDTH, HEIGHT) == pytest.approx(
        camera.focal_length, rel=3e-4
    )  # 43.27 mm


@pytest.mark.parametrize(
    ("tags", "focal_px"),
    [
        ({"f": 35.0, "resolution": 100.0, "unit": 3}, 350),  # 100 pixels a centimetre
        ({"f": 35.0, "resolution": 10.0, "unit": 4}, 350),  # a millimetre
        ({"f": 25.4, "resolution": 500.0}, 500),  # the unit left out: inches
        (
            {"f": 25.4, "resolution": 5000.0, "unit": 2, "across": 3200},
            500,
        ),  # a picture shrunk by ten
    ],
)
def test_a_focal_length_in_pixels_of_the_focal_plane(tmp_path, tags, focal_px):
    assert focal_length_px(photograph(tmp_path / "a.jpg", **tags), WIDTH, HEIGHT) == pytest.approx(
        focal_px, rel=1e-3
    )


@pytest.mark.parametrize("tags", [{}, {"f": 35.0}, {"f35": 0, "f": 0.0}, {"f35": 10}, {"f35": 352}])
def test_too_little_and_nonsense_tell_nothing(tmp_path, tags):
    assert focal_length_px(photograph(tmp_path / "a.jpg", **tags), WIDTH, HEIGHT) is None


def test_broken_data_are_no_data(tmp_path):
    photograph(tmp_path / "a.jpg", f35=26)
    whole = bytearray((tmp_path / "a.jpg").read_bytes())
    start = whole.index(b"Exif\0\0") + 6
    whole[start : start + 8] = b"\xff" * 8
    (tmp_path / "a.jpg").write_bytes(whole)
    assert read_exif(tmp_path / "a.jpg") == {}
    assert read_exif(tmp_path / "nowhere.jpg") == {}
    assert focal_length_px({0xA405: "26 mm", 0x920A: float("inf")}, WIDTH, HEIGHT) is None
    assert [orientation_of({0x0112: value}) for value in (6, 0, 9, "x", None)] == [6, 1, 1, 1, 1]


def test_bodies_differ_by_what_changes_a_lens():
    exif = {0x010F: "Maker", 0x0110: "Model", 0xA431: "17", 0x920A: 35.0}
    assert body_of({}, (320, 240)) is None
    others = ({}, {0xA431: "18"}, {0x920A: 50.0}, {0x010F: "Other"})
    bodies = [body_of(exif | more, (320, 240)) for more in others]
    assert len({*bodies, body_of(exif, (640, 480))}) == 5
    assert body_of(dict(exif), (320, 240)) == bodies[0]
