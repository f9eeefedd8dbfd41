"""Transforms: closed form, perturbations, and their file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.transforms import Transform, identity, load_transform, umeyama
from tests.refusals import refuse

seeds = st.integers(0, 2**32 - 1)
EYE = np.eye(4)


def similarity(rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * Rotation.random(rng=rng).as_matrix()
    matrix[:3, 3] = rng.uniform(-1, 1, 3)
    return matrix


@given(seeds, st.booleans())
def test_a_weight_of_two_is_a_point_seen_twice(seed, with_scale):
    """To 1e-8, since of unrelated points the rotation may be badly conditioned."""
    source, target = np.random.default_rng(seed).uniform(-1, 1, (2, 5, 3))
    twice = umeyama(source[[0, 0, 1, 2, 3, 4]], target[[0, 0, 1, 2, 3, 4]], with_scale)
    weighted = umeyama(source, target, with_scale, np.array([2.0, 1, 1, 1, 1]))
    np.testing.assert_allclose(weighted, twice, atol=1e-8)


def test_a_points_covariance_grows_with_its_distance_from_the_pivot():
    """1 mrad about each axis is 0.3 mm sideways at 0.3 m along z."""
    transform = Transform("photo", "radar", EYE, np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6]))
    expected = np.diag([1e-6 * 0.09, 1e-6 * 0.09, 0])
    found = transform.point_covariance(np.array([[0, 0, 0.3]]))
    np.testing.assert_allclose(found, expected[None], atol=1e-20)
    refuse(lambda: identity("radar").point_covariance(np.zeros(3)), "radar_from_radar")


@pytest.mark.parametrize("unknowns", [0, 6])
def test_a_transform_file_comes_back(tmp_path, rng, unknowns):
    root = rng.standard_normal((unknowns, unknowns)) * 1e-4
    covariance = root @ root.T if unknowns else None
    saved = Transform("photo", "radar", similarity(rng, 1.01), covariance, np.array([1e-4, 2e-4]))
    saved.save(tmp_path / "t.json")
    loaded = load_transform(tmp_path / "t.json")
    assert loaded.require("photo", "radar", "t.json") is loaded
    np.testing.assert_equal([loaded.matrix, loaded.covariance], [saved.matrix, covariance])
    assert loaded.residuals_m == (1e-4, 2e-4)
    assert loaded.inverse().require("radar", "photo", "").inverse().source == "photo"
    keys = {"from", "to", "matrix", "scale", "covariance", "residuals_m", "refined"}
    assert json.loads((tmp_path / "t.json").read_text()).keys() == keys


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("matrix", EYE),
        ("matrix", np.diag([1.0, 1, -1, 1])),
        ("matrix", EYE + 0.01 * np.eye(4, k=1) * [[1], [0], [0], [0]]),
        ("matrix", EYE + 0.1 * np.eye(4)[::-1] * [[0], [0], [0], [1]]),
        ("matrix", [[1, 2], [3]]),
        ("matrix", np.where(EYE, np.nan, 0)),
        ("matrix", EYE + 1e9 * np.eye(4, k=3)),
        ("covariance", np.eye(5)),
        ("covariance", -np.eye(6)),
        ("covariance", np.eye(6) + 0.1 * np.eye(6, k=1)),
        ("matrix", EYE == 1),
        ("matrix", 1.01 * EYE + np.diag([0, 0, 0, -0.01])),
        ("scale", 1000),
        ("unit", "mm"),
        ("residuals_m", ["a"]),
    ],
)
def test_a_wrong_transform_file_is_refused(tmp_path, key, value):
    """The first row is right, but not if a key stands twice: a reflection, a shear, and another
    last row follow."""
    path = tmp_path / "t.json"
    content = {"from": "photo", "to": "radar", "matrix": EYE, "scale": 1, "covariance": np.eye(6)}
    text = json.dumps(content | {key: value}, default=np.ndarray.tolist)
    path.write_text(text)
    if value is EYE:
        load_transform(path)
        path.write_text(text.replace('"from"', '"to": "radar", "from"'))
        refuse(lambda: load_transform(path), str(path), "'to'")
    else:
        refuse(lambda: load_transform(path), str(path), f"'{key}")
