"""Cameras against a survey, on photographs of a room whose cameras are known."""

import numpy as np
import pytest

from handbench.bench.studies import measure_survey
from tests.groundtruth import room

VIEWS = 4


@pytest.mark.slow
def test_both_ways_find_the_surveyed_centres(ran, tmp_path):
    for folder in ("images", "cameras"):
        (tmp_path / folder).mkdir()
    room.photograph(tmp_path / "images", VIEWS)
    (tmp_path / "K.txt").write_text("440 0 200 0 440 150 0 0 1")
    for i, centre_m in enumerate(room.around(VIEWS)):
        numbers = np.zeros(26)
        numbers[21:24] = centre_m
        file = tmp_path / "cameras" / f"p{i}.png.camera"
        file.write_text(" ".join(map(repr, numbers.tolist())))
    words = ["--counts", str(VIEWS), "--shrinks", "1", "--only", "1/1, K"]
    rows = ran(measure_survey, str(tmp_path), *words)["rows"]
    assert [row["way"] for row in rows] == ["handbench", "plain COLMAP"]
    assert all(row["registered"] == VIEWS and row["centre_m"] < 1e-3 for row in rows)
