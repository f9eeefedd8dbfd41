"""The error that all centres of a target share."""

from __future__ import annotations

import numpy as np

from handbench.calibration.registration import common_covariance


def test_what_all_centres_share_lies_along_z(target):
    """∂/∂ε of (√ε − 1)·(R − a) for the deepest ball: 0.003 of 20 mm over 2√1.03 is 0.0296 mm; and
    0.062 pixel."""
    foam_m, seen_m = 0.003 * 0.020 / (2 * np.sqrt(1.03)), 0.062 * 6e-4
    np.testing.assert_allclose(common_covariance(target), np.diag([0, 0, foam_m**2]), atol=1e-18)
    np.testing.assert_allclose(
        common_covariance(target, 6e-4), np.diag([0, 0, foam_m**2 + seen_m**2]), atol=1e-18
    )
