"""Photographs on disk."""

import numpy as np
import pytest
from PIL import Image

from calibration import HandbenchError
from groundtruth.photos import find_photos, read_gray


def write(folder, count=3, size=(12, 8), suffix=".png"):
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        Image.new("RGB", size, (40 * i, 80, 120)).save(folder / f"p{i}{suffix}")


def test_finds_them_by_name_here_or_in_images(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b" / "images", suffix=".JPG")
    assert [p.name for p in find_photos(tmp_path / "a")] == ["p0.png", "p1.png", "p2.png"]
    photos = find_photos(tmp_path / "b")
    assert [(p.name, p.width, p.height) for p in photos] == [(f"p{i}.JPG", 12, 8) for i in range(3)]
    assert photos[0].body is None


def test_a_missing_folder_and_too_few_are_refused(tmp_path):
    with pytest.raises(HandbenchError, match="expected a folder with photographs"):
        find_photos(tmp_path / "nowhere")
    write(tmp_path, count=2)
    with pytest.raises(HandbenchError, match=r"found 2 photographs .* at least 3"):
        find_photos(tmp_path)


def test_a_truncated_photograph_is_named(tmp_path):
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)).save(tmp_path / "bad.jpg")
    whole = (tmp_path / "bad.jpg").read_bytes()
    (tmp_path / "bad.jpg").write_bytes(whole[: len(whole) // 2])
    write(tmp_path)
    with pytest.raises(HandbenchError, match=r"bad\.jpg: is not a readable photograph"):
        find_photos(tmp_path)


def test_sixteen_bits_keep_their_steps(tmp_path):
    values = np.arange(64, dtype=np.uint16).reshape(8, 8) + 30000
    Image.fromarray(values).save(tmp_path / "deep.png")
    np.testing.assert_allclose(read_gray(tmp_path / "deep.png"), values / 65535, atol=1e-7)


def test_pixels_stay_as_the_sensor_stored_them(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # "turn me by 90°"
    exif[0x0110] = "Camera"
    for i in range(3):
        Image.new("L", (12, 8)).save(tmp_path / f"p{i}.jpg", exif=exif)
    photos = find_photos(tmp_path)
    assert (photos[0].width, photos[0].height) == (12, 8)
    assert photos[0].body == photos[1].body is not None
