"""Fronts of bodies with exact echoes."""

import numpy as np

from tests.references.exact.cases import SCENES, Case, front_m
from tests.references.exact.cylinders import ALONG


def test_the_front_is_the_nearest_surface():
    name = "finger before palm, 12 mm aside"
    x_m = np.array([-0.03, 0.0, 0.012, 0.0199])
    found = front_m(Case(name, SCENES[name], "skin", ALONG), x_m, np.array([0.0, 0.02]))
    edge_m = 0.265 - np.sqrt(8e-3**2 - 7.9e-3**2)
    np.testing.assert_allclose(found, np.tile([np.nan, 0.299, 0.257, edge_m], (2, 1)))
