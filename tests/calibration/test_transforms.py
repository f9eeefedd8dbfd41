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


@given(seeds, st.integers(3, 8), st.floats(0.1, 10))
def test_umeyama_recovers_a_similarity_exactly(seed, n, scale):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (n, 3))
    matrix = similarity(rng, scale)
    target = source @ matrix[:3, :3].T + matrix[:3, 3]
    # three random points may be nearly collinear, which magnifies rounding
    tolerance = 1e-13 / np.linalg.svd(source - source.mean(axis=0), compute_uv=False)[1] ** 2
    np.testing.assert_allclose(
        umeyama(source, target, with_scale=True), matrix, atol=scale * max(tolerance, 1e-12)
    )


@given(seeds)
def test_umeyama_never_reflects(seed):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (5, 3))
    matrix = umeyama(source, source * [1, 1, -1])
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)


@given(seeds)
def test_umeyama_is_the_least_squares_solution(seed):
    rng = np.random.default_rng(seed)
    source, target = rng.uniform(-1, 1, (2, 6, 3))
    best = Transform("a", "b", umeyama(source, target, with_scale=True))
    cost = ((best.points(source) - target) ** 2).sum()
    gradient = np.einsum(
        "nia,ni->a", perturbation_jacobian(best.points(source)), target - best.points(source)
    )
    np.testing.assert_allclose(gradient, 0, atol=1e-10)
    other = Transform("a", "b", similarity(rng, best.scale))
    assert cost <= ((other.points(source) - target) ** 2).sum()


@given(seeds, st.booleans())
def test_a_weight_of_two_is_a_point_seen_twice(seed, with_scale):
    rng = np.random.default_rng(seed)
    source, target = rng.uniform(-1, 1, (2, 5, 3))
    twice = umeyama(source[[0, 0, 1, 2, 3, 4]], target[[0, 0, 1, 2, 3, 4]], with_scale)
    weighted = umeyama(source, target, with_scale, np.array([2.0, 1, 1, 1, 1]))
    np.testing.assert_allclose(
        weighted, twice, atol=1e-8
    )  # unrelated points: the rotation may be badly conditioned


def test_a_scale_needs_points_that_lie_apart():
    with pytest.raises(HandbenchError, match="all 3 source points coincide"):
        umeyama(np.zeros((3, 3)), np.eye(3), with_scale=True)


def test_without_scale_the_scale_is_one(rng):
    source = rng.uniform(-1, 1, (5, 3))
    assert Transform("a", "b", umeyama(source, 2 * source)).scale == pytest.approx(1, abs=1e-12)


def test_the_inverse_undoes(rng):
    transform = Transform("photo", "radar", similarity(rng, 1.3))
    points = rng.uniform(-1, 1, (2, 4, 3))
    back = transform.inverse()
    assert (back.source, back.target) == ("radar", "photo")
    np.testing.assert_allclose(back.points(transform.points(points)), points, atol=1e-12)
    np.testing.assert_allclose(transform.rotation @ transform.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(identity("radar").points(points), points)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_inverse_undoes_far_from_the_origin_at_any_scale(rng, scale):
    """Tolerance: four roundings of the largest number on the way back, 1e6 m over the scale."""
    matrix = similarity(rng, scale)
    matrix[:3, 3] *= 1e6
    transform, points = Transform("photo", "radar", matrix), rng.uniform(-1, 1, (4, 3))
    back = transform.inverse().points(transform.points(points))
    np.testing.assert_allclose(back, points, atol=4 * np.finfo(float).eps * 1e6 / scale)


def test_the_jacobian_is_the_derivative(rng):
    point, step = rng.uniform(-1, 1, 3), 1e-6 * rng.standard_normal(7)
    moved = np.exp(step[6]) * Rotation.from_rotvec(step[3:6]).apply(point) + step[:3]
    np.testing.assert_allclose(moved - point, perturbation_jacobian(point) @ step, atol=1e-11)


def test_a_points_covariance_grows_with_its_distance_from_the_pivot():
    covariance = np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6])  # 1 mrad about each axis
    transform = Transform("photo", "radar", np.eye(4), covariance)
    expected = np.diag([1e-6 * 0.09, 1e-6 * 0.09, 0])  # 0.3 m away along z: 0.3 mm sideways
    np.testing.assert_allclose(
        transform.point_covariance(np.array([[0, 0, 0.3]])), expected[None], atol=1e-20
    )
    with pytest.raises(HandbenchError, match="carries no covariance"):
        identity("radar").point_covariance(np.zeros(3))


@pytest.mark.parametrize("unknowns", [None, 6, 7])
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
    keys = {"from", "to", "matrix", "scale", "covariance", "residuals_m"}
    assert json.loads((tmp_path / "t.json").read_text()).keys() == keys


EYE = np.eye(4).tolist()
GOOD = {
    "from": "photo",
    "to": "radar",
    "matrix": EYE,
    "covariance": np.eye(6).tolist(),
    "residuals_m": [],
}
MIRROR = np.diag([1.0, 1, -1, 1]).tolist()
SHEAR = (np.eye(4) + 0.01 * np.eye(4, k=1) * [[1], [0], [0], [0]]).tolist()
PROJECTIVE = (np.eye(4) + 0.1 * np.eye(4)[::-1] * [[0], [0], [0], [1]]).tolist()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"matrix": MIRROR}, "reflections and shears are refused"),
        ({"matrix": SHEAR}, "reflections and shears are refused"),
        ({"matrix": np.zeros((4, 4)).tolist()}, "reflections and shears are refused"),
        ({"matrix": PROJECTIVE}, "expected [0, 0, 0, 1]"),
        ({"matrix": np.eye(3).tolist()}, "expected 4×4 finite numbers"),
        ({"matrix": [[1, 2], [3]]}, "expected 4×4 finite numbers"),
        ({"matrix": [["1"] * 4] * 4}, "expected 4×4 finite numbers"),
        ({"matrix": [[None] * 4] * 4}, "expected 4×4 finite numbers"),
        ({"matrix": [[10**400] * 4] * 4}, "expected 4×4 finite numbers"),
        ({"matrix": (1e200 * np.eye(4)).tolist()}, "expected 4×4 finite numbers"),
        ({"matrix": {"__class__": "os.system"}}, "expected 4×4 finite numbers"),
        ({"matrix": "\n".join("import os" for _ in range(100))}, "expected 4×4 finite numbers"),
        ({"matrix": np.where(np.eye(4), np.nan, 0).tolist()}, "expected 4×4 finite numbers"),
        ({"covariance": np.eye(5).tolist()}, "expected 6×6 or 7×7 finite numbers"),
        ({"covariance": (-np.eye(6)).tolist()}, "'covariance' is not symmetric and positive"),
        (
            {"covariance": np.triu(np.ones((6, 6))).tolist()},
            "'covariance' is not symmetric and positive",
        ),
        ({"residuals_m": [[1.0]]}, "expected a list of finite numbers"),
        ({"residuals_m": ["a"]}, "expected a list of finite numbers"),
        ({"from": 3}, "expected names of frames"),
        ({"from": ["photo"]}, "expected names of frames"),
    ],
)
def test_a_malformed_transform_file_is_refused_in_one_line(tmp_path, change, expected):
    path = tmp_path / "t.json"
    path.write_text(json.dumps(GOOD | change))
    with pytest.raises(HandbenchError) as caught:
        load_transform(path)
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 300
    path.write_text(json.dumps(GOOD))
    load_transform(path)


def test_a_transform_a_million_metres_away_comes_back(tmp_path, rng):
    """Its covariance about the origin is (1e6 m · 1 mrad)²; a thousand times further is no place on
    Earth."""
    matrix = similarity(rng, 1e3)
    matrix[:3, 3] *= 1e6
    covariance = 1e6 * np.eye(6)
    Transform("photo", "radar", matrix, covariance).save(tmp_path / "t.json")
    after = load_transform(tmp_path / "t.json")
    np.testing.assert_array_equal(after.matrix, matrix)
    np.testing.assert_array_equal(after.covariance, covariance)
    for key, value in {
        "matrix": np.diag([1, 1, 1, 1]) + 1e9 * np.eye(4, k=3),
        "residuals_m": np.array([1e9]),
    }.items():
        (tmp_path / "t.json").write_text(json.dumps(GOOD | {key: value.tolist()}))
        with pytest.raises(HandbenchError, match=f"'{key}' is .* finite numbers"):
            load_transform(tmp_path / "t.json")


@pytest.mark.parametrize(
    "text", ["", "[]", "null", "{}", '{"from": "a", "to": "b"}', "[" * 100_000, "import os"]
)
def test_what_is_no_transform_file_is_refused(tmp_path, text):
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(HandbenchError, match="expected"):
        load_transform(tmp_path / "t.json")
