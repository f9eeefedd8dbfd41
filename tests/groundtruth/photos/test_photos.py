"""Photographs on disk: found, refused, and read as COLMAP reads them; bad ones are left out."""

import shutil
import sys

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import find_photos, read_gray, select_usable
from handbench.support.errors import HandbenchError
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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda folder: (folder / "a.png").write_bytes(b"no picture"),
            r"a\.png: is not a readable JPEG, PNG, TIFF",
        ),
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
    """Its pixels stay as the sensor stored them."""
    path, mode, exif = tmp_path / name, name.split(".")[1], Image.Exif()
    exif[0x0112] = 6  # "turn me by 90°"
    colour = Image.fromarray(np.stack([grey] * 3, axis=-1))
    if mode == "16":
        cv2.imwrite(str(path), np.asarray(colour).astype(np.uint16) * 257 + 100)
        whole = (grey * 257.0 + 100) / 65535
        np.testing.assert_allclose(read_gray(path), whole, atol=2e-7)
    else:
        converted = colour.convert(mode)
        if mode == "RGBA":
            converted.putalpha(Image.fromarray(255 - grey))
        converted.save(path, quality=98, exif=exif)
    assert np.abs(255 * read_gray(path) - colmaps_gray(path)).max() <= 2.5
    assert np.abs(255 * read_gray(path) - grey).mean() <= 2


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
    with pytest.raises(HandbenchError, match="only 1 photographs are different; expected"):
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


@pytest.mark.parametrize(("gain", "offset"), [(0.25, 0), (0.3, 0.7)])
def test_the_tones_of_dark_and_bright_photographs_are_stretched(tmp_path, capsys, gain, offset):
    """The others stay bit for bit."""
    photograph(tmp_path)
    usual = np.asarray(Image.open(tmp_path / "p1.png"))
    changed = (gain * usual + offset * 255).round().clip(0, 255).astype(np.uint8)
    Image.fromarray(np.dstack([changed, np.full_like(changed, 255)])).save(tmp_path / "p1.png")
    photos = find_photos(tmp_path)
    assert [photo.stretched for photo in photos] == [False, True, False, False]
    assert np.array_equal(photos[0].gray(), read_gray(photos[0].path))
    select_usable(photos)
    assert "whose tones are stretched: p1.png" in capsys.readouterr().err
    black, white = np.quantile(usual, (0.01, 0.99))
    expected = ((usual - black) / (white - black)).clip(0, 1)
    assert np.abs(photos[1].gray() - expected).max() < 0.03
    photos[1].save_copy(tmp_path / "copy.CR2")
    np.testing.assert_allclose(colmaps_gray(tmp_path / "copy.CR2"), 255 * expected, atol=8)


def test_transparent_pixels_do_not_count_for_the_tones(tmp_path):
    photograph(tmp_path)
    dark = np.asarray(Image.open(tmp_path / "p0.png")) // 5
    border = np.zeros_like(dark)
    border[20:-20, 20:-20] = 255
    Image.fromarray(np.dstack([np.where(border, dark, 255), border])).save(tmp_path / "p0.png")
    assert find_photos(tmp_path)[0].tones[1] < 0.21


def digital_negative(path, light):
    """Write linear light [height, width], uint16, as a DNG file of a camera held upright, whose
    Bayer pattern's equal values are gray."""
    height, width = light.shape
    xyz_to_camera = (3.24, -1.54, -0.50, -0.97, 1.88, 0.04, 0.06, -0.20, 1.06)
    tags = ImageFileDirectory_v2()
    for tag, kind, value in (
        *((256, 4, width), (257, 4, height), (258, 3, 16), (259, 3, 1), (262, 3, 32803)),
        *((271, 2, "Maker"), (272, 2, "Camera"), (273, 4, 0), (274, 3, 6), (277, 3, 1)),
        *((278, 4, height), (279, 4, light.nbytes), (33421, 3, (2, 2)), (33422, 1, b"\0\1\1\2")),
        *((50706, 1, b"\1\4\0\0"), (50708, 2, "Camera"), (50721, 10, xyz_to_camera)),
        *((50728, 5, (1.0, 1.0, 1.0)), (50778, 3, 21)),
    ):
        tags.tagtype[tag], tags[tag] = kind, value
    with path.open("wb") as file:
        tags.save(file)  # adds their size to tag 273, the place of the pixels
        file.write(light.tobytes())


def test_raw_photographs_are_developed_as_the_sensor_stored_them(tmp_path):
    pytest.importorskip("rawpy")
    photograph(tmp_path, 3)
    picture = np.asarray(Image.open(tmp_path / "p2.png"))
    digital_negative(tmp_path / "p1.DNG", np.arange(12, dtype=np.uint16).reshape(3, 4))
    digital_negative(tmp_path / "p3.DNG", ((picture / 255) ** 2.2 * 9000).astype(np.uint16))
    photos = find_photos(tmp_path)
    assert names(photos) == ["p0.png", "p1.png", "p2.png", "p3.DNG"]  # p1.png is developed
    assert not photos[3].plain and (photos[3].width, photos[3].height) == (400, 300)
    assert np.corrcoef(photos[3].gray().ravel(), picture.ravel())[0, 1] > 0.98


def test_heic_photographs_are_read(tmp_path, grey):
    pytest.importorskip("pillow_heif").register_heif_opener()
    write(tmp_path)
    Image.fromarray(grey).save(tmp_path / "p3.HEIC", quality=98)
    photo = find_photos(tmp_path)[3]
    assert photo.name == "p3.HEIC" and not photo.plain
    assert np.abs(255 * photo.gray() - grey).mean() < 2


@pytest.mark.parametrize(
    ("name", "module", "extra"), [("a.NEF", "rawpy", "raw"), ("a.heic", "pillow_heif", "heic")]
)
def test_photographs_of_extras_are_refused_without_these(
    tmp_path, monkeypatch, name, module, extra
):
    write(tmp_path)
    (tmp_path / name).write_bytes(b"picture")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(HandbenchError, match=rf"{name}: .*pip install 'handbench\[{extra}\]'"):
        find_photos(tmp_path)
