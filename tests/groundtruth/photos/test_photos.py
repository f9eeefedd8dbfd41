"""Photographs on disk: found, refused, and read as COLMAP reads them; bad ones are left out."""

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import find_photos, photo_quality, read_gray, select_usable
from handbench.support.errors import HandbenchError
from tests.groundtruth.room import around, look, photograph


def write(folder, count=3, size=(12, 8), suffix=".png"):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        Image.new("RGB", size, (40 * i, 80, 120)).save(folder / f"p{i}{suffix}")


@pytest.fixture
def grey():
    """A picture [48, 64] with every tone, smooth enough for JPEG."""
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    return (127.5 + 127.5 * np.sin(x / 7) * np.cos(y / 9)).astype(np.uint8)


def test_finds_them_by_name_here_or_in_images(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b" / "images", suffix=".JPG")
    assert [p.name for p in find_photos(tmp_path / "a")] == ["p0.png", "p1.png", "p2.png"]
    photos = find_photos(tmp_path / "b")
    assert [(p.name, p.width, p.height) for p in photos] == [(f"p{i}.JPG", 12, 8) for i in range(3)]
    assert photos[0].body is None and photos[0].focal_px is None and photos[0].orientation == 1


def test_a_missing_folder_and_too_few_are_refused(tmp_path):
    with pytest.raises(HandbenchError, match="expected a folder with photographs"):
        find_photos(tmp_path / "nowhere")
    write(tmp_path, count=2)
    with pytest.raises(HandbenchError, match=r"found 2 photographs .* at least 3"):
        find_photos(tmp_path)


@pytest.mark.parametrize("name", ["bad.jpg", "bad.png", "deep.png", "deep.tif"])
def test_a_truncated_photograph_is_named(tmp_path, name):
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    cv2.imwrite(
        str(tmp_path / name), noise.astype(np.uint16) * 257 if name.startswith("deep") else noise
    )
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    write(tmp_path)
    with pytest.raises(HandbenchError, match=rf"{name}: is not a readable photograph"):
        find_photos(tmp_path)


def test_sixteen_bits_keep_their_steps(tmp_path):
    values = np.arange(64, dtype=np.uint16).reshape(8, 8) + 30000
    Image.fromarray(values).save(tmp_path / "grey.png")
    for name in ("colour.png", "colour.tif"):
        cv2.imwrite(str(tmp_path / name), np.repeat(values[..., None], 3, axis=2))
    for name in ("grey.png", "colour.png", "colour.tif"):
        np.testing.assert_allclose(read_gray(tmp_path / name), values / 65535, atol=2e-7)


def test_thirty_two_bits_are_refused(tmp_path):
    Image.fromarray(np.zeros((8, 8), dtype=np.float32)).save(tmp_path / "a.tif")
    with pytest.raises(HandbenchError, match=r"a\.tif: has 32 bits a pixel; expected 8 or 16"):
        read_gray(tmp_path / "a.tif")


@pytest.mark.parametrize(
    "mode", ["L", "RGB", "RGBA", "LA", "P", "CMYK jpg", "CMYK tif", "16 png", "16 tif", "I;16"]
)
def test_every_kind_of_file_reads_as_in_colmap(tmp_path, grey, mode):
    path = tmp_path / f"a.{mode.split()[-1] if ' ' in mode else 'png'}"
    colour = Image.fromarray(np.stack([grey] * 3, axis=-1))
    if mode.startswith("16"):
        cv2.imwrite(str(path), np.asarray(colour).astype(np.uint16) * 257)
    elif mode == "I;16":
        Image.fromarray(grey.astype(np.uint16) * 257).save(path)
    elif mode in ("RGBA", "LA"):
        see_through = colour.convert(mode)
        see_through.putalpha(Image.fromarray(255 - grey))
        see_through.save(path)
    else:
        colour.convert(mode.split()[0]).save(path, quality=98)
    as_colmap = np.asarray(load_pycolmap().Bitmap.read(str(path), as_rgb=False).to_array())
    assert np.abs(255 * read_gray(path) - as_colmap).max() <= (
        6 if mode == "P" else 2.5
    )  # the palette has colours
    assert np.abs(255 * read_gray(path) - grey).mean() <= (30 if mode == "P" else 2)


def test_pixels_stay_as_the_sensor_stored_them_here_and_in_colmap(tmp_path, grey):
    exif = Image.Exif()
    exif[0x0112] = 6  # "turn me by 90°"
    exif[0x0110] = "Camera"
    for i in range(3):
        Image.fromarray(grey).save(tmp_path / f"p{i}.jpg", exif=exif)
    photos = find_photos(tmp_path)
    assert (photos[0].width, photos[0].height, photos[0].orientation) == (64, 48, 6)
    assert photos[0].body == photos[1].body is not None
    colmap = load_pycolmap()
    colmap.Database.open(tmp_path / "database.db").close()
    colmap.import_images(
        tmp_path / "database.db", tmp_path, colmap.CameraMode.PER_IMAGE, ["p0.jpg"]
    )
    with colmap.Database.open(tmp_path / "database.db") as stored:
        [camera] = stored.read_all_cameras()
    assert (camera.width, camera.height) == (64, 48)
    as_colmap = np.asarray(colmap.Bitmap.read(str(photos[0].path), as_rgb=False).to_array())
    np.testing.assert_allclose(255 * photos[0].gray(), as_colmap, atol=2.5)


def test_a_mirrored_picture_is_refused(tmp_path):
    write(tmp_path)
    exif = Image.Exif()
    exif[0x0112] = 5
    Image.new("L", (12, 8)).save(tmp_path / "mirror.jpg", exif=exif)
    with pytest.raises(
        HandbenchError, match=r"mirror\.jpg: its EXIF orientation 5 says that it is mirrored"
    ):
        find_photos(tmp_path)


def names(photos):
    return [photo.name for photo in photos]


def test_good_photographs_pass_without_a_word(tmp_path, capsys):
    photograph(tmp_path)
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert capsys.readouterr().err == ""


def test_repetitions_are_dropped(tmp_path, capsys):
    photograph(tmp_path)
    Image.open(tmp_path / "p1.png").save(tmp_path / "p9.tif")  # another file, the same pixels
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    assert "p9.tif: the same pixels as p1.png; left out" in capsys.readouterr().err
    for i in (0, 2, 3):
        (tmp_path / f"p{i}.png").write_bytes((tmp_path / "p1.png").read_bytes())
    with pytest.raises(HandbenchError, match="only 1 photographs differ; at least 3 are needed"):
        select_usable(find_photos(tmp_path))


def blurred(path, kernel):
    cv2.imwrite(str(path), cv2.filter2D(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), -1, kernel))


@pytest.mark.parametrize("kind", ["defocus", "motion"])
def test_a_blurred_photograph_is_left_out_if_enough_remain(tmp_path, capsys, kind):
    photograph(tmp_path)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)) / 61.0
    blurred(tmp_path / "p2.png", disc if kind == "defocus" else np.eye(13) / 13)
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p3.png"]
    assert "p2.png: blurred (" in (said := capsys.readouterr().err) and "left out" in said
    (tmp_path / "p0.png").unlink()
    assert names(select_usable(find_photos(tmp_path))) == ["p1.png", "p2.png", "p3.png"]
    assert "used, since there are few" in capsys.readouterr().err


def test_sharpness_is_no_matter_of_contrast_and_plain_surfaces(tmp_path):
    photograph(tmp_path, 3)
    picture = np.asarray(Image.open(tmp_path / "p0.png"))
    Image.fromarray((60 + 0.4 * picture).astype(np.uint8)).save(tmp_path / "p1.png")
    Image.fromarray(np.pad(picture, 150, constant_values=200)).save(tmp_path / "p2.png")
    sharp, dim, framed = (photo_quality(photo).sharpness for photo in find_photos(tmp_path))
    assert dim == pytest.approx(sharp, rel=0.1) and framed == pytest.approx(sharp, rel=0.35)


def test_photographs_without_texture_are_refused(tmp_path):
    random = np.random.default_rng(0)
    for i in range(4):
        x, y = np.meshgrid(np.linspace(0, 1, 400), np.linspace(0, 1, 300))
        shaded = 120 + 60 * x * y + 10 * i + random.normal(0, 2, x.shape)
        Image.fromarray(shaded.astype(np.uint8)).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match="0 of 4 photographs show enough texture"):
        select_usable(find_photos(tmp_path))
    for i in range(2):
        Image.fromarray(look(around(2)[i])).save(tmp_path / f"p{i}.png")
    with pytest.raises(HandbenchError, match="2 of 4 photographs show enough texture"):
        select_usable(find_photos(tmp_path))
