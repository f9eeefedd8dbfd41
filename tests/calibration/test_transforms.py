"""Transforms: closed form, perturbations, and their file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import (
    Transform,
    identity,
    load_transform,
    perturbation_jacobian,
    umeyama,
)
from handbench.support.errors import HandbenchError

seeds = st.integers(0, 2**32 - 1)


def similarity(rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.random(rng=rng).as_matrix()
    matrix[:3, 3] = rng.uniform(-1, 1, 3)
    return matrix


@given(seeds)
def test_umeyama_never_reflects(seed):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (5, 3))
    matrix = umeyama(source, source * [1, 1, -1])
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)


@given(seeds, st.booleans())
def test_a_weight_of_two_is_a_point_seen_twice(seed, with_scale):
    rng = np.random.default_rng(seed)
    source, target = rng.uniform(-1, 1, (2, 5, 3))
    twice = umeyama(source[[0, 0, 1, 2, 3, 4]], target[[0, 0, 1, 2, 3, 4]], with_scale)
    weighted = umeyama(source, target, with_scale, np.array([2.0, 1, 1, 1, 1]))
    np.testing.assert_allclose(
        weighted, twice, atol=1e-8
    )  # unrelated points: the rotation may be badly conditioned


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_inverse_undoes_far_from_the_origin_at_any_scale(rng, scale):
    """Tolerance: four roundings of the largest number on the way back, 1e6 m over the scale."""
    matrix = similarity(rng, scale)
    matrix[:3, 3] *= 1e6
    transform, points = Transform("photo", "radar", matrix), rng.uniform(-1, 1, (4, 3))
    back = transform.inverse().points(transform.points(points))
    np.testing.assert_allclose(back, points, atol=4 * np.finfo(float).eps * 1e6 / scale)


def test_the_jacobian_is_the_derivative(rng):
    point, step = rng.uniform(-1, 1, 3), 1e-6 * rng.standard_normal(6)
    moved = Rotation.from_rotvec(step[3:6]).apply(point) + step[:3]
    np.testing.assert_allclose(moved - point, perturbation_jacobian(point) @ step, atol=1e-11)


def test_a_points_covariance_grows_with_its_distance_from_the_pivot():
    covariance = np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6])  # 1 mrad about each axis
    transform = Transform("photo", "radar", np.eye(4), covariance)
    expected = np.diag([1e-6 * 0.09, 1e-6 * 0.09, 0])  # 0.3 m away along z: 0.3 mm sideways
    np.testing.assert_allclose(
        transform.point_covariance(np.array([[0, 0, 0.3]])), expected[None], atol=1e-20
    )
    with pytest.raises(HandbenchError, match="has no covariance"):
        identity("radar").point_covariance(np.zeros(3))


@pytest.mark.parametrize("unknowns", [None, 6])
def test_a_transform_file_comes_back(tmp_path, rng, unknowns):
    root = rng.standard_normal((unknowns or 1, unknowns or 1)) * 1e-4
    covariance = root @ root.T if unknowns else None
    before = Transform("photo", "radar", similarity(rng, 1.01), covariance, np.array([1e-4, 2e-4]))
    before.save(tmp_path / "t.json")
    after = load_transform(tmp_path / "t.json")
    assert (after.source, after.target) == ("photo", "radar")
    np.testing.assert_array_equal(after.matrix, before.matrix)
    np.testing.assert_array_equal(after.residuals_m, before.residuals_m)
    assert unknowns is None or np.array_equal(after.covariance, covariance)
    keys = {"from", "to", "matrix", "scale", "covariance", "residuals_m", "refined"}
    assert json.loads((tmp_path / "t.json").read_text()).keys() == keys


EYE = np.eye(4)
GOOD = {
    "from": "photo",
    "to": "radar",
    "matrix": EYE.tolist(),
    "covariance": np.eye(6).tolist(),
    "residuals_m": [],
}
NO_ROTATION, NO_MATRIX = "it has a reflection or a shear", "'matrix"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"matrix": np.diag([1.0, 1, -1, 1])}, NO_ROTATION),
        ({"matrix": EYE + 0.01 * np.eye(4, k=1) * [[1], [0], [0], [0]]}, NO_ROTATION),
        ({"matrix": EYE + 0.1 * np.eye(4)[::-1] * [[0], [0], [0], [1]]}, "last row is not"),
        ({"matrix": [[1, 2], [3]]}, NO_MATRIX),
        ({"matrix": [[10**400] * 4] * 4}, NO_MATRIX),
        ({"matrix": "\n".join("import os" for _ in range(100))}, NO_MATRIX),
        ({"matrix": np.where(EYE, np.nan, 0)}, NO_MATRIX),
        ({"matrix": EYE + 1e9 * np.eye(4, k=3)}, "should be less than"),
        ({"covariance": np.eye(5)}, "'covariance' is"),
        ({"covariance": -np.eye(6)}, "symmetric and positive"),
        ({"covariance": np.ones((6, 7))}, "'covariance' is"),
        ({"covariance": [1] * 37}, "'covariance' is [1, 1"),
        ({"covariance": []}, "'covariance' is"),
        ({"residuals_m": ["a"]}, "'residuals_m.0' is 'a'"),
        ({"refined": {}}, "'refined' is {}"),
        ({"from": ["photo"]}, "'from' is"),
        ("[]", "valid dictionary"),
        ("[" * 100_000, "expected"),
    ],
)
def test_a_wrong_transform_file_is_refused_in_one_line(tmp_path, change, words):
    path = tmp_path / "t.json"
    text = change
    if isinstance(change, dict):
        text = json.dumps(GOOD | change, default=np.ndarray.tolist)
    path.write_text(text)
    with pytest.raises(HandbenchError) as caught:
        load_transform(path)
    assert words in str(caught.value) and str(path) in str(caught.value)
    assert len(str(caught.value)) < 500
    path.write_text(json.dumps(GOOD))
    load_transform(path)
