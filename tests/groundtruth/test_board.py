"""Board files."""

import pytest

from calibration import HandbenchError
from groundtruth.board import Board, Marker, load_board, save_board

CORNERS = ((0.0, 0.03, 0.0), (0.03, 0.03, 0.0), (0.03, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_round_trip_through_a_file(tmp_path):
    board = Board(dictionary="DICT_5X5_100", marker=(Marker(id=4, corners_m=CORNERS),))
    save_board(tmp_path / "board.toml", board)
    assert load_board(tmp_path / "board.toml") == board


def test_mistakes_are_named(tmp_path):
    path = tmp_path / "board.toml"
    marker = f"[[marker]]\nid = 1\ncorners_m = {[list(c) for c in CORNERS]}\n"
    path.write_text(marker * 2)
    with pytest.raises(HandbenchError, match="two markers have the same id"):
        load_board(path)
    path.write_text("[[marker]]\nid = 1\ncorners_m = [[0.0, 0.0, 0.0]]\n")
    with pytest.raises(HandbenchError, match=r"corners_m.*at least 4"):
        load_board(path)
    path.write_text('dictionary = "APRIL"\n' + marker)
    with pytest.raises(HandbenchError, match="unknown dictionary 'APRIL'"):
        load_board(path).cv_dictionary()
