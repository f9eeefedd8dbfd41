"""Photographs on disk: found, refused, and read as COLMAP reads them; bad ones are left out."""

import shutil
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.photos import find_photos, read_gray, select_usable
from tests.groundtruth.room import photograph
from tests.refusals import refuse

ROWS, COLUMNS = np.mgrid[:48, :64]
GRAY = (127 + 127 * np.sin(COLUMNS / 7) * np.cos(ROWS / 9)).astype(np.uint8)  # smooth, all tones


def write(folder, suffix=".png"):
    folder.mkdir(parents=True)
    for i in range(3):
        Image.new("RGB", (12, 8), (40 * i, 80, 120)).save(folder / f"p{i}{suffix}")
    return folder


def names(photos):
    return [photo.name for photo in photos]


def test_finds_them_by_name_here_or_in_images(tmp_path):
    """Not a RAW file of the same name as another one."""
    write(tmp_path / "a")
    (tmp_path / "a" / "p1.DNG").write_bytes(b"not read")
    assert names(find_photos(tmp_path / "a")) == ["p0.png", "p1.png", "p2.png"]
    write(tmp_path / "b" / "images", ".JPG")
    photos = find_photos(tmp_path / "b")
    assert [(p.name, p.width, p.height) for p in photos] == [(f"p{i}.JPG", 12, 8) for i in range(3)]


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda folder: (folder / "a.png").write_bytes(b"no picture"), "a.png"),
        (lambda folder: (folder / "a.webp").write_bytes(b"not read"), "a.webp"),
        (lambda folder: Image.fromarray(GRAY[:1]).save(folder / "a.png"), "× 1 pixels"),
        (lambda folder: Image.fromarray(GRAY.astype("f4")).save(folder / "a.tif"), "32 bits"),
        (lambda folder: (folder / "p0.png").unlink(), "2 photographs"),
        (shutil.rmtree, "photos"),
    ],
    ids=["broken", "unread", "tiny", "deep", "few", "none"],
)
def test_wrong_photographs_are_refused(tmp_path, change, place):
    change(write(tmp_path / "photos"))
    refuse(lambda: find_photos(tmp_path / "photos"), str(tmp_path / "photos"), place)


def colmaps_gray(path):
    return np.asarray(load_pycolmap().Bitmap.read(str(path), as_rgb=False).to_array())


@pytest.mark.parametrize("name", ["a.L.png", "a.RGBA.png", "a.CMYK.jpg", "a.16.tif"])
def test_every_kind_of_file_reads_as_in_colmap(tmp_path, name):
    """Its pixels stay as the sensor stored them."""
    path, mode, exif = tmp_path / name, name.split(".")[1], Image.Exif()
    exif[0x0112] = 6  # "turn me by 90°"
    colour = Image.fromarray(np.stack([GRAY] * 3, axis=-1))
    if mode == "16":
        cv2.imwrite(str(path), np.asarray(colour).astype(np.uint16) * 257 + 100)
        whole = (GRAY * 257.0 + 100) / 65535
        np.testing.assert_allclose(read_gray(path), whole, atol=2e-7)
    else:
        converted = colour.convert(mode)
        if mode == "RGBA":
            converted.putalpha(Image.fromarray(255 - GRAY))
        converted.save(path, quality=98, exif=exif)
    assert np.abs(255 * read_gray(path) - colmaps_gray(path)).max() <= 2.5
    assert np.abs(255 * read_gray(path) - GRAY).mean() <= 2


def test_repetitions_are_dropped(tmp_path, capsys):
    """Also in another kind of file."""
    photograph(tmp_path)
    Image.open(tmp_path / "p1.png").save(tmp_path / "p9.tif")
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p2.png", "p3.png"]
    printed = capsys.readouterr().err
    assert "p9.tif" in printed and "p1.png" in printed and "p0.png" not in printed
    for i in (0, 2, 3):
        (tmp_path / f"p{i}.png").write_bytes((tmp_path / "p1.png").read_bytes())
    photos = find_photos(tmp_path)
    refuse(lambda: select_usable(photos), str(tmp_path), "1 of 5")


@pytest.mark.parametrize("kind", ["defocus", "motion"])
def test_a_blurred_photograph_is_left_out_if_enough_remain(tmp_path, capsys, kind):
    photograph(tmp_path)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)) / 61.0
    kernel, path = disc if kind == "defocus" else np.eye(13) / 13, str(tmp_path / "p2.png")
    cv2.imwrite(path, cv2.filter2D(cv2.imread(path, cv2.IMREAD_GRAYSCALE), -1, kernel))
    assert names(select_usable(find_photos(tmp_path))) == ["p0.png", "p1.png", "p3.png"]
    assert "p2.png" in capsys.readouterr().err
    (tmp_path / "p0.png").unlink()
    assert names(select_usable(find_photos(tmp_path))) == ["p1.png", "p2.png", "p3.png"]
    assert "p2.png" in capsys.readouterr().err


@pytest.mark.parametrize(("gain", "offset"), [(0.25, 0), (0.3, 0.7)])
def test_the_tones_of_dark_and_bright_photographs_are_stretched(tmp_path, capsys, gain, offset):
    """Transparent pixels do not count; the other photographs stay bit for bit."""
    photograph(tmp_path)
    usual = np.asarray(Image.open(tmp_path / "p1.png")) / 255
    opaque = np.arange(usual.shape[1]) >= 20 + 0 * usual
    changed = np.where(opaque, gain * usual + offset, offset == 0)
    both = np.dstack([changed.clip(0, 1), opaque])
    Image.fromarray((255 * both).round().astype(np.uint8)).save(tmp_path / "p1.png")
    photos = find_photos(tmp_path)
    assert [photo.stretched for photo in photos] == [False, True, False, False]
    assert np.array_equal(photos[0].gray(), read_gray(photos[0].path))
    select_usable(photos)
    assert capsys.readouterr().err.strip().endswith(": p1.png")
    black, white = np.quantile(usual[opaque], (0.01, 0.99))
    expected = ((usual[opaque] - black) / (white - black)).clip(0, 1)
    np.testing.assert_allclose(photos[1].gray()[opaque], expected, atol=0.03)
    photos[1].save_copy(tmp_path / "copy.CR2")
    copied = colmaps_gray(tmp_path / "copy.CR2")[opaque]
    np.testing.assert_allclose(copied, 255 * expected, atol=8)


def test_photographs_of_extras_are_refused_without_these(tmp_path, monkeypatch):
    (write(tmp_path / "photos") / "a.NEF").write_bytes(b"picture")
    monkeypatch.setitem(sys.modules, "rawpy", None)
    refuse(lambda: find_photos(tmp_path / "photos"), "a.NEF", "handbench[raw]")
