"""MAROON's alignment.json: their frame and ours, strict reading, and files that both can use."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.maroon_alignment import load_alignment, save_alignment
from handbench.calibration.transforms import Transform
from handbench.support.errors import HandbenchError
from tests.bench.datasets.maroon_writer import write_alignment
from tests.strategies import examples


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


@examples(50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 1.7]), st.booleans())
def test_a_transform_comes_back(tmp_path_factory, seed, scale, mirrored):
    path = tmp_path_factory.mktemp("alignment") / "alignment.json"
    before = ours(seed, scale)
    write_alignment(path, before, mirrored)
    after = load_alignment(path)  # the matrix tells the hand
    assert (after.source, after.target, after.covariance) == ("photo", "radar", None)
    np.testing.assert_allclose(after.matrix, before.matrix, rtol=1e-12, atol=1e-12 * scale)


def test_a_camera_beside_the_radar_is_where_it_stands(tmp_path):
    """Up stays up, away stays away, and what is to the right has negative x with us."""
    transform = load_alignment(written(tmp_path / "a.json", photogrammetry2radar=BESIDE))
    seen = np.array([[0, 0, 0.3], [0.02, 0, 0.3], [0, 0.05, 0.3]])  # ahead, to the right, below
    expected = [[-0.1, 0, 0.3], [-0.12, 0, 0.3], [-0.1, -0.05, 0.3]]
    np.testing.assert_allclose(transform.points(seen), expected, atol=1e-15)
    assert np.linalg.det(transform.matrix[:3, :3]) == pytest.approx(1)


def test_their_code_carries_points_as_ours_with_x_negated(tmp_path):
    rng = np.random.default_rng(20240607)
    transform, points = ours(), rng.uniform(-1, 1, (5, 3))
    save_alignment(tmp_path / "a.json", transform)
    calib = json.loads((tmp_path / "a.json").read_text())
    carried = theirs(points, "photogrammetry", "radar", calib)
    np.testing.assert_allclose(carried * [-1, 1, 1], transform.points(points), atol=1e-12)
    np.testing.assert_allclose(
        theirs(carried, "radar", "photogrammetry", calib), points, atol=1e-12
    )
    assert np.linalg.det(np.array(calib["photogrammetry2radar"])[:3, :3]) == pytest.approx(-1)
    np.testing.assert_array_equal(calib["radar2world"], np.eye(4))


def test_other_keys_stay(tmp_path):
    world = (2 * np.eye(4)).tolist()
    path = written(tmp_path / "a.json", kinect2radar=BESIDE, radar2world=world, kinect_calib={"space": "color"},
                   photogrammetry2radar=BESIDE)  # fmt: skip
    save_alignment(path, ours())
    after = json.loads(path.read_text())
    assert (after["kinect2radar"], after["radar2world"], after["kinect_calib"]) == (
        BESIDE,
        world,
        {"space": "color"},
    )
    assert after["photogrammetry2radar"] != BESIDE
    np.testing.assert_allclose(
        after["photogrammetry2world"], np.array(world) @ after["photogrammetry2radar"], atol=1e-12
    )
    np.testing.assert_allclose(load_alignment(path).matrix, ours().matrix, atol=1e-12)


def test_cameras_lead_from_millimetres(tmp_path):
    matrix = np.array(BESIDE) @ np.diag([1e-3, 1e-3, 1e-3, 1])
    transform = load_alignment(written(tmp_path / "a.json", kinect2radar=matrix.tolist()), "kinect")
    assert transform.source == "kinect" and transform.scale == pytest.approx(1e-3)
    np.testing.assert_allclose(
        transform.points(np.array([20, 50, 300.0])), [-0.12, -0.05, 0.3], atol=1e-15
    )


def test_single_precision_is_straightened_without_a_word(tmp_path, capsys):
    single = np.diag([-1.0, 1, 1, 1]) @ ours(3).matrix
    path = written(
        tmp_path / "a.json",
        photogrammetry2radar=single.astype(np.float32).astype(float).ravel().tolist(),
    )
    matrix = load_alignment(path).matrix
    np.testing.assert_allclose(
        matrix, ours(3).matrix, atol=1e-7
    )  # float32's rounding of numbers below 1 is 6e-8
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-7)
    assert capsys.readouterr().err == ""


def test_a_crooked_matrix_is_straightened_aloud_and_a_very_crooked_one_refused(tmp_path, capsys):
    crooked = np.array(BESIDE)
    crooked[0, 1] = 4e-4
    matrix = load_alignment(
        written(tmp_path / "a.json", photogrammetry2radar=crooked.tolist())
    ).matrix
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-6)
    assert (
        "2.0e-04 off a rotation" in capsys.readouterr().err
    )  # the nearest rotation takes half of it
    crooked[0, 1] = 4e-3
    with pytest.raises(
        HandbenchError, match=r"0\.002 off a rotation with one scale; expected 0\.001"
    ):
        load_alignment(written(tmp_path / "a.json", photogrammetry2radar=crooked.tolist()))


@pytest.mark.parametrize("mirrored", [True, False])
def test_the_other_reading_carries_mirror_images(tmp_path, mirrored):
    """Asked for against the matrix, x comes out negated, the scale tells it, and the inverse undoes
    it."""
    write_alignment(tmp_path / "a.json", ours(), mirrored)
    other = load_alignment(tmp_path / "a.json", mirrored=not mirrored)
    points = np.random.default_rng(5).uniform(-1, 1, (5, 3))
    np.testing.assert_allclose(other.points(points), ours().points(points) * [-1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(other.inverse().points(other.points(points)), points, atol=1e-12)
    assert (ours().scale, other.scale) == (pytest.approx(1), pytest.approx(-1))


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_file_keeps_its_hand(tmp_path, mirrored):
    write_alignment(tmp_path / "a.json", ours(1), mirrored)
    save_alignment(tmp_path / "a.json", ours(2))
    calib = json.loads((tmp_path / "a.json").read_text())
    assert (np.linalg.det(np.array(calib["photogrammetry2radar"])[:3, :3]) < 0) == mirrored
    np.testing.assert_allclose(
        load_alignment(tmp_path / "a.json").matrix, ours(2).matrix, atol=1e-12
    )


def changed(row: int, column: int, value: object) -> list:
    matrix = [list(line) for line in BESIDE]
    matrix[row][column] = value
    return matrix


@pytest.mark.parametrize(("matrix", "expected"), [
    (changed(0, 0, float("nan")), "expected 4×4 or 16 finite numbers"),
    (changed(0, 0, "1"), "expected 4×4 or 16 finite numbers"),
    (changed(0, 0, None), "expected 4×4 or 16 finite numbers"),
    (BESIDE[:3], "expected 4×4 or 16 finite numbers"),
    ([[1, 2], [3]], "expected 4×4 or 16 finite numbers"),
    (changed(3, 0, 0.1), r"last row .* expected \[0, 0, 0, 1\]"),
    (changed(0, 3, 300.0), "shifts by 300 m; expected metres"),
    (changed(2, 2, 0.0), "off a rotation"),
    (np.diag([0, 0, 0, 1]).tolist(), "inf off a rotation"),
])  # fmt: skip
def test_what_is_no_transform_is_refused(tmp_path, matrix, expected):
    with pytest.raises(HandbenchError, match=expected):
        load_alignment(written(tmp_path / "a.json", photogrammetry2radar=matrix))


def test_an_unknown_source_is_answered_with_the_nearest(tmp_path):
    path = written(tmp_path / "a.json", photogrammetry2radar=BESIDE, zed2radar=BESIDE)
    with pytest.raises(
        HandbenchError, match="has no 'photogrametry2radar'; did you mean 'photogrammetry'"
    ):
        load_alignment(path, "photogrametry")
    with pytest.raises(HandbenchError, match="known: photogrammetry, zed"):
        load_alignment(path, "lidar")


@pytest.mark.parametrize(("content", "expected"), [
    (b"\x80\x04]q\x00.", "is not readable as JSON"),  # a pickle
    (b"[1, 2]", "holds no table of transforms"),
    (b"{", "is not readable as JSON"),
])  # fmt: skip
def test_only_json_is_read(tmp_path, content, expected):
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(HandbenchError, match=expected):
        load_alignment(tmp_path / "a.json")
    with pytest.raises(HandbenchError, match=expected):  # nor is it overwritten
        save_alignment(tmp_path / "a.json", ours())
    assert (tmp_path / "a.json").read_bytes() == content


def test_a_huge_file_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "a.json").open("wb") as stream:
        stream.truncate(2**27)  # sparse
    with pytest.raises(HandbenchError, match="has 134217728 bytes"):
        load_alignment(tmp_path / "a.json")


def test_another_transform_is_not_saved(tmp_path):
    with pytest.raises(HandbenchError, match="expected one from 'photo' to 'radar'"):
        save_alignment(tmp_path / "a.json", ours().inverse())
    assert not (tmp_path / "a.json").exists()
