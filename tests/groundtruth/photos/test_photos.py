"""Photographs on disk: found, refused, and read as COLMAP reads them; bad ones are left out."""

import shutil

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import find_photos, read_gray, select_usable
from handbench.support.errors import HandbenchError
from tests.groundtruth.photos.test_exif import colmaps_camera
from tests.groundtruth.room import photograph


def write(folder, count=3, size=(12, 8), suffix=".png"):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        Image.new("RGB", size, (40 * i, 80, 120)).save(folder / f"p{i}{suffix}")


@pytest.fixture
def grey():
    """A picture [48, 64] with every tone, smooth enough for JPEG."""
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    return (127 + 127 * np.sin(x / 7) * np.cos(y / 9)).astype(np.uint8)


def test_finds_them_by_name_here_or_in_images(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b" / "images", suffix=".JPG")
    assert [p.name for p in find_photos(tmp_path / "a")] == ["p0.png", "p1.png", "p2.png"]
    photos = find_photos(tmp_path / "b")
    assert [(p.name, p.width, p.height) for p in photos] == [(f"p{i}.JPG", 12, 8) for i in range(3)]
    assert photos[0].body is None and photos[0].focal_px is None and photos[0].orientation == 1


def _mirrored(folder):
    exif = Image.Exif()
    exif[0x0112] = 5
    Image.new("L", (12, 8)).save(folder / "mirror.jpg", exif=exif)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda folder: (folder / "a.png").write_bytes(b"no picture"),
            r"a\.png: is not a readable JPEG, PNG, TIFF",
        ),
        (_mirrored, r"mirror\.jpg: its EXIF orientation 5 says that the picture is mirrored"),
        (
            lambda folder: Image.fromarray(np.zeros((8, 8), np.float32)).save(folder / "a.tif"),
            r"a\.tif: has 32 bits per pixel; save it with 8 or 16",
        ),
        (lambda folder: (folder / "p0.png").unlink(), r"found only 2 photographs .* at least 3"),
        (shutil.rmtree, "expected a folder with photographs"),
    ],
)
def test_wrong_photographs_are_refused(tmp_path, change, words):
    write(tmp_path / "photos")
    change(tmp_path / "photos")
    with pytest.raises(HandbenchError, match=words):
        [read_gray(photo.path) for photo in find_photos(tmp_path / "photos")]


def colmaps_gray(path):
    return np.asarray(load_pycolmap().Bitmap.read(str(path), as_rgb=False).to_array())


@pytest.mark.parametrize("name", ["a.L.png", "a.RGB.png", "a.RGBA.png", "a.CMYK.jpg", "a.16.tif"])
def test_every_kind_of_file_reads_as_in_colmap(tmp_path, grey, name):
    path, mode = tmp_path / name, name.split(".")[1]
    colour = Image.fromarray(np.stack([grey] * 3, axis=-1))
    if mode == "16":
        cv2.imwrite(str(path), np.asarray(colour).astype(np.uint16) * 257 + 100)
        whole = (grey * 257.0 + 100) / 65535
        np.testing.assert_allclose(read_gray(path), whole, atol=2e-7)
    else:
        converted = colour.convert(mode)
        if mode == "RGBA":
            converted.putalpha(Image.fromarray(255 - grey))
        converted.save(path, quality=98)
    assert np.abs(255 * read_gray(path) - colmaps_gray(path)).max() <= 2.5
    assert np.abs(255 * read_gray(path) - grey).mean() <= 2


def test_pixels_stay_as_the_sensor_stored_them_here_and_in_colmap(tmp_path, grey):
    exif = Image.Exif()
    exif[0x0112] = 6  # "turn me by 90°"
    exif[0x0110] = "Camera"
    for i in range(3):
        Image.fromarray(grey).save(tmp_path / f"p{i}.jpg", exif=exif)
    photos = find_photos(tmp_path)
    assert (photos[0].width, photos[0].height, photos[0].orientation) == (64, 48, 6)
    assert photos[0].body == photos[1].body is not None
    camera = colmaps_camera(tmp_path, "p0.jpg")
    assert (camera.width, camera.height) == (64, 48)
    np.testing.assert_allclose(255 * photos[0].gray(), colmaps_gray(photos[0].path), atol=2.5)


def names(photos):
    return [photo.name for photo in photos]


def test_repetitions_are_dropped(tmp_path, capsys):
    photograph(tmp_path)
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert capsys.readouterr().err == ""
    Image.open(tmp_path / "p1.png").save(tmp_path / "p9.tif")  # another file, the same pixels
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert "p9.tif: has the same pixels as p1.png" in capsys.readouterr().err
    for i in (0, 2, 3):
        (tmp_path / f"p{i}.png").write_bytes((tmp_path / "p1.png").read_bytes())
    with pytest.raises(
        HandbenchError, match="only 1 photographs are different; expected at least 3"
    ):
        select_usable(find_photos(tmp_path))


def blurred(path, kernel):
    cv2.imwrite(str(path), cv2.filter2D(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), -1, kernel))


@pytest.mark.parametrize("kind", ["defocus", "motion"])
def test_a_blurred_photograph_is_left_out_if_enough_remain(tmp_path, capsys, kind):
    photograph(tmp_path)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)) / 61.0
    blurred(tmp_path / "p2.png", disc if kind == "defocus" else np.eye(13) / 13)
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p3.png"]
    assert "p2.png: is blurred (" in (printed := capsys.readouterr().err) and "left out" in printed
    (tmp_path / "p0.png").unlink()
    assert names(select_usable(find_photos(tmp_path))) == ["p1.png", "p2.png", "p3.png"]
    assert "used, because there are only a few" in capsys.readouterr().err


def test_photographs_without_texture_are_refused(tmp_path):
    photograph(tmp_path, 4)
    for i in (0, 1):
        shade = np.tile(np.linspace(120, 180, 400), (300, 1))
        shade += np.random.default_rng(i).normal(0, 2, shade.shape)
        Image.fromarray(shade.astype(np.uint8)).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match="2 of 4 photographs show enough texture"):
        select_usable(find_photos(tmp_path))
