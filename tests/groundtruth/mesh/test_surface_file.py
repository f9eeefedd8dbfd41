"""Surfaces in files: ours, and those of others."""

import numpy as np
import pytest

from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.groundtruth.mesh.surface import Surface, metric_mesh, read_surface
from handbench.interface import load
from tests.refusals import refuse

VERTICES_M = np.array([(0, 0, 0.3), (0.1, 0, 1 / 3), (0, 0.1, 0.3), (0.1, 0.1, 0.3 + 1e-15)])
FACES = np.array([(0, 2, 1), (1, 2, 3)])


def test_everything_comes_back(tmp_path):
    """All 64 bits of places, 32 of standard deviations."""
    sigma_m, observed = np.array([1e-5, 2.5e-5, np.nan, 1.0]), np.array([True, False, True, False])
    surface = Surface(VERTICES_M, FACES, sigma_m, observed, VERTICES_M[::-1] / 3)
    surface.save(tmp_path / "A.PLY")
    found = read_surface(tmp_path / "A.PLY")
    single = sigma_m.astype(np.float32).astype(float)
    np.testing.assert_equal(vars(found), vars(surface) | {"sigma_m": single})
    assert found.sigma_m.dtype == np.float64 and found.observed.dtype == bool


def test_what_has_no_scale_is_shown_and_nowhere_measured(tmp_path):
    surface = Surface(VERTICES_M, FACES, np.full(4, 1e-5), np.ones(4, bool), scaled=False)
    file = tmp_path / "a.ply"
    surface.save(file)
    assert not load(file).scaled and "no scale" in repr(load(file))
    refuse(lambda: read_surface(file), str(file), "--unscaled")
    refuse(lambda: metric_mesh(file, 1e-3), str(file), "--unscaled")


@pytest.mark.parametrize(
    ("columns", "observed", "sigma_m"),
    [
        ({}, [True] * 4, [np.nan] * 4),
        ({"observed": np.array([1, -1, 0, 1], "i4")}, [True, False, False, True], [np.nan] * 4),
        ({"sigma_m": np.array([1e-5, 2e-5, 3e-5, 0])}, [True] * 4, [1e-5, 2e-5, 3e-5, 0]),
    ],
)
def test_one_of_the_two_is_enough_and_of_any_type(tmp_path, columns, observed, sigma_m):
    """What is not plainly seen was not; a mesh that says nothing was seen everywhere."""
    write_ply(tmp_path / "a.ply", by_axis(VERTICES_M) | columns, FACES)
    found = read_surface(tmp_path / "a.ply")
    assert found.observed.tolist() == observed
    np.testing.assert_array_equal(found.sigma_m, sigma_m)
    write_ply(tmp_path / "b.ply", by_axis(VERTICES_M) | {"sigma_m": -np.ones(4)}, FACES)
    refuse(lambda: read_surface(tmp_path / "b.ply"), "b.ply", "sigma_m")
