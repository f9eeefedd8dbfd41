"""Depth maps on disk."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.depthmap import DepthMap, load_depthmap
from tests.refusals import refuse

Z_M = np.array([[0.3, np.nan, 0.31], [0.32, 0.3, 0.3]])
PLAIN = DepthMap(np.arange(3.0), np.arange(2.0), Z_M, Z_M - 1, "2fsk", {"f1_hz": 1.0})
WHOLE = replace(
    PLAIN,
    sigma_m=Z_M / 1e3,
    wrapped=Z_M > 0.305,
    p_gross=Z_M,
    velocity_m_s=-Z_M,
    velocity_sigma_m_s=Z_M / 10,
    velocity_limit_m_s=0.5,
)


@pytest.mark.parametrize("depth", [PLAIN, WHOLE])
def test_every_field_comes_back(tmp_path, depth):
    depth.save(tmp_path / "d.npz")
    np.testing.assert_equal(vars(load_depthmap(tmp_path / "d.npz")), vars(depth))


@pytest.mark.parametrize(
    ("name", "value", "place"),
    [
        ("x_m", np.arange(5.0), "(2, 5)"),
        ("sigma_m", Z_M[:1], "(1, 3)"),
        ("z_m", np.full((2, 3), 300, np.uint16), "uint16"),
        ("wrapped", Z_M, "float64"),
        ("velocity_limit_m_s", -1.0, "-1"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, name, value, place):
    replace(WHOLE, **{name: value}).save(tmp_path / "d.npz")
    refuse(lambda: load_depthmap(tmp_path / "d.npz"), "d.npz", place)


def test_a_map_needs_a_pixel():
    none = replace(PLAIN, x_m=np.arange(0.0), z_m=Z_M[:, :0], amplitude_db=Z_M[:, :0])
    refuse(lambda: none.checked("map"), "map", "x_m")
