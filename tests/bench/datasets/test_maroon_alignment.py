"""MAROON's alignment.json: their frame and ours, and strict reading."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.maroon_alignment import load_alignment
from handbench.calibration.transforms import Transform
from handbench.support.errors import HandbenchError
from tests.bench.datasets.maroon_writer import write_alignment


def ours(seed: int = 0, scale: float = 1.0) -> Transform:
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.random(rng=rng).as_matrix()
    matrix[:3, 3] = rng.uniform(-1, 1, 3)
    return Transform("photo", "radar", matrix)


def theirs(points: np.ndarray, source: str, dest: str, calib: dict) -> np.ndarray:
    """Their README's rule: the matrix of `source2dest` on columns [p, 1], or the inverse of the
    other one's."""
    matrix = np.array(calib[f"{source}2{dest}"]).reshape(4, 4)
    return np.c_[points, np.ones(len(points))] @ matrix.T[:, :3]


def written(path, **content):
    path.write_text(json.dumps(content))
    return path


# A camera beside the radar that looks the same way: x right, y down, z away; 0.1 m to the right of
# the array, whose own frame they draw with x right, y up, z away. We draw x to the left.
BESIDE = [[1, 0, 0, 0.1], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def test_their_code_carries_points_as_ours_with_x_negated(tmp_path):
    transform, points = ours(), np.random.default_rng(20240607).uniform(-1, 1, (5, 3))
    to_radar = np.diag([-1, 1, 1, 1]) @ transform.matrix
    path = written(tmp_path / "a.json", photogrammetry2radar=to_radar.ravel().tolist())
    carried = theirs(points, "photogrammetry", "radar", json.loads(path.read_text()))
    found = load_alignment(path).points(points)
    np.testing.assert_allclose(found, carried * [-1, 1, 1], atol=1e-12)


def test_a_crooked_matrix_is_straightened_and_reported(tmp_path, capsys):
    """Rounding to float32, 6e-8 of numbers below 1, is not reported."""
    single = (np.diag([-1, 1, 1, 1]) @ ours(3).matrix).astype(np.float32).astype(float)
    crooked = np.array(BESIDE)
    crooked[0, 1] = 4e-4  # the nearest rotation takes half of it
    for matrix, words in ((single, r"^$"), (crooked, "differs by 2.0e-04 from a rotation")):
        path = written(tmp_path / "a.json", photogrammetry2radar=matrix.ravel().tolist())
        axes = load_alignment(path).matrix[:3, :3]
        np.testing.assert_allclose(axes, np.diag([-1, 1, 1]) @ matrix[:3, :3], atol=3e-4)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-6)
        assert re.search(words, capsys.readouterr().err)


@pytest.mark.parametrize("mirrored", [True, False])
def test_the_other_reading_carries_mirror_images(tmp_path, mirrored):
    """Asked for against the matrix, x comes out negated, and the scale is."""
    path = tmp_path / "a.json"
    before = ours(0, 1.7)
    write_alignment(path, before, mirrored)
    other = load_alignment(path, mirrored=not mirrored)
    points = np.random.default_rng(5).uniform(-1, 1, (5, 3))
    np.testing.assert_allclose(other.points(points), before.points(points) * [-1, 1, 1], atol=1e-12)
    assert other.scale == pytest.approx(-1.7)


def changed(row: int, column: int, value: object) -> dict:
    matrix = [list(line) for line in BESIDE]
    matrix[row][column] = value
    return {"photogrammetry2radar": matrix}


NUMBERS = "expected 4×4 or 16 finite numbers"
REFUSED = {
    "NaN": (changed(0, 0, float("nan")), NUMBERS),
    "last row": (changed(3, 0, 0.1), r"last row .* expected \[0, 0, 0, 1\]"),
    "millimetres": (changed(0, 3, 300.0), "has a shift of 300 m; expected at most"),
    "crooked": (
        changed(0, 1, 4e-3),
        r"differs by 0\.002 from a rotation with one scale; expected at most 0\.001",
    ),
    "source": ({"photogrametry2radar": BESIDE}, "did you mean 'photogrametry'"),
    "list": ([1, 2], "is not a table"),
    "huge": (b" " * 2**27, "has 134217728 bytes"),
}


@pytest.mark.parametrize(("content", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_alignment_is_refused(tmp_path, content, words):
    file = tmp_path / "a.json"
    file.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    with pytest.raises(HandbenchError, match=words):
        load_alignment(file)
