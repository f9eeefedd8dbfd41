"""Groups of photographs that share a lens, and what COLMAP gets to know of it."""

import numpy as np
import pytest
from PIL import Image

from handbench.groundtruth.board import CHESSBOARD, Board, Charuco
from handbench.groundtruth.cameras import load_pycolmap
from handbench.groundtruth.photos import Photo, find_photos
from handbench.groundtruth.sparse.inputs import Known
from handbench.groundtruth.sparse.sfm import find_features, named_pictures
from tests.groundtruth.test_board import slanted


def database(known, folder, lenses):
    """COLMAP's cameras by photograph, and whether a board gave focal lengths."""
    by_board = find_features(known, folder / "database.db", lenses)
    with load_pycolmap().Database.open(folder / "database.db") as content:
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
        images = sorted(content.read_all_images(), key=lambda image: image.name)
    return [cameras[image.camera_id] for image in images], by_board


@pytest.mark.parametrize(
    ("lenses", "shared"), [("auto", [1, 2, 1, 2]), ("one", [1, 2, 1, 2]), ("each", [1, 2, 3, 4])]
)
def test_photographs_of_a_size_share_a_lens_unless_each_has_its_own(tmp_path, lenses, shared):
    """Without EXIF data; by these COLMAP groups itself."""
    for i, width in enumerate((160, 170, 160, 170)):
        Image.effect_noise((width, 120), 50).save(tmp_path / f"p{i}.png")
    cameras, by_board = database(Known(find_photos(tmp_path)), tmp_path, lenses)
    assert [camera.camera_id for camera in cameras] == shared and not by_board


def test_a_board_gives_focal_lengths_also_of_photographs_that_show_too_little(tmp_path):
    board = Board(charuco=Charuco(columns=5, rows=5, square_m=0.03, marker_m=0.02))
    pixels = slanted(0.15, 0.15).project(board.corners_m()[CHESSBOARD])
    seen = {(CHESSBOARD, k): pixel for k, pixel in enumerate(pixels)}
    for name in "abc":
        Image.new("L", (800, 600)).save(tmp_path / f"{name}.png")
    corners = {"a.png": seen, "b.png": {}, "c.png": seen}
    known = Known(find_photos(tmp_path), board=board, corners=corners)
    cameras, by_board = database(known, tmp_path, "each")
    assert by_board
    assert [camera.params[0] for camera in cameras] == pytest.approx([900] * 3, rel=0.01)


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
