"""Groups of photographs that share a lens, and what COLMAP gets to know of it."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.board.board import CHESSBOARD, Board, Charuco
from handbench.groundtruth.cameras.cameras import load_pycolmap
from handbench.groundtruth.photos.photos import Photo, find_photos
from handbench.groundtruth.sparse.inputs import Known
from handbench.groundtruth.sparse.sfm import find_features, named_pictures
from tests.groundtruth.board.test_board import slanted


def photographs(folder, models):
    """With EXIF data of a camera and a focal length where its model is not blank."""
    for i, model in enumerate(models):
        exif = Image.Exif()
        if model.strip():
            exif[0x010F], exif[0x0110] = "maker", model
            exif.get_ifd(0x8769)[0xA405] = 50
        size = (120, 160 + 10 * (model == "\t"))
        noise = np.random.default_rng(i).integers(0, 255, size, dtype=np.uint8)
        Image.fromarray(noise).save(folder / f"p{i}.jpg", exif=exif)
    return find_photos(folder)


@pytest.mark.parametrize(
    ("models", "lenses", "shared"),
    [
        ("AAABB", "auto", [1, 1, 1, 2, 2]),
        ("AAABB", "one", [1, 1, 1, 1, 1]),
        ("AAABB", "each", [1, 2, 3, 4, 5]),
        ("  \t \t", "auto", [1, 1, 2, 1, 2]),  # without EXIF data: by size
    ],
)
def test_photographs_share_lenses_by_exif_or_size(tmp_path, models, lenses, shared):
    photos = photographs(tmp_path, models)
    assert not find_features(Known(photos), tmp_path / "database.db", lenses)
    with load_pycolmap().Database.open(tmp_path / "database.db") as content:
        images = {image.name: image for image in content.read_all_images()}
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
    found = [images[f"p{i}.jpg"].camera_id for i in range(5)]
    assert found == shared
    assert cameras[1].has_prior_focal_length == (models[0] == "A")


def test_a_board_gives_focal_lengths_also_of_photographs_that_show_too_little(tmp_path):
    board = Board(charuco=Charuco(columns=5, rows=5, square_m=0.03, marker_m=0.02))
    pixels = slanted(0.15, 0.15).project(board.corners_m()[CHESSBOARD])
    seen = {(CHESSBOARD, k): pixel for k, pixel in enumerate(pixels)}
    for name in "abc":
        Image.new("L", (800, 600)).save(tmp_path / f"{name}.png")
    corners = {"a.png": seen, "b.png": {}, "c.png": seen}
    known = Known(find_photos(tmp_path), board=board, corners=corners)
    assert find_features(known, tmp_path / "database.db", "each")
    with load_pycolmap().Database.open(tmp_path / "database.db") as content:
        focal_px = [camera.params[0] for camera in content.read_all_cameras()]
    assert focal_px == pytest.approx([900] * 3, rel=0.01)


def test_colmap_finds_photographs_of_other_names_and_tones_under_their_names(tmp_path):
    gray = np.random.default_rng(0).integers(0, 255, (6, 8), dtype=np.uint8)
    files = [tmp_path / "e\u0301.png", tmp_path / "b.png"]  # é in two characters
    for file in files:
        Image.fromarray(gray).save(file)
    photos = (Photo(files[0], "é.png", 8, 6), Photo(files[1], "b.png", 8, 6, tones=(0, 0.5)))
    folder = named_pictures(photos, tmp_path)
    assert folder == named_pictures(photos, tmp_path) != tmp_path
    assert sorted(file.name for file in folder.iterdir()) == ["b.png", "é.png"]
    for photo in photos:
        read = np.asarray(load_pycolmap().Bitmap.read(str(folder / photo.name), False).to_array())
        np.testing.assert_allclose(read, 255 * photo.gray(), atol=0.51)
