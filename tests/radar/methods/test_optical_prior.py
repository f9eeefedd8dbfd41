"""Depths about another sensor's: a sphere's cap in closed form, priors that are noisy, wrong or not
of these pixels."""

import numpy as np
import pytest

from handbench.radar.data.depthmap import DepthMap
from handbench.support.errors import HandbenchError
from tests.radar.simulated_points import around, depth_by, exact_capture

AT_M = (0.02, -0.01, 0.28)
X_M, Y_M = (at + np.arange(-6, 7) * 1e-3 for at in AT_M[:2])


def found(tmp_path, z_m, **values):
    """The depth map about a prior of one scatterer."""
    path = tmp_path / "prior.npz"
    DepthMap(X_M[: z_m.shape[1]], Y_M, z_m, np.zeros_like(z_m), "kinect").save(path)
    pixels = around(AT_M, half_m=0.006) | {"tolerance": 1e-4, "prior": str(path)}
    return depth_by("prior-2fsk", exact_capture(AT_M, [82e9, 81.8e9, 77e9]), pixels | values)


def test_a_prior_of_five_millimetres_leaves_nothing_of_its_error(tmp_path):
    """0.02 mm in the scatterer's pixel, whatever the prior's error: it is one depth, and noise has
    none in it."""
    prior_m = AT_M[2] + 5e-3 * np.random.default_rng(1).uniform(-1, 1, (13, 13))
    depth = found(tmp_path, prior_m, fine_filter_px=1, edge_m=0.0)
    assert depth.z_m[6, 6] == pytest.approx(AT_M[2], abs=2e-5) and not depth.wrapped[6, 6]


def test_a_part_that_is_wrong_is_flagged(tmp_path):
    """The outer columns of the lobe 30 mm off: flagged there or dropped, and not in the middle."""
    prior_m = np.full((13, 13), AT_M[2])
    prior_m[:, 8:] += 0.03
    depth = found(tmp_path, prior_m, drop_doubtful=False, fine_filter_px=1)
    seen = np.isfinite(depth.z_m)
    assert depth.wrapped[seen & (np.arange(13) >= 8)].all() and not depth.wrapped[5:8, 5:7].any()


@pytest.mark.parametrize(
    ("prior_m", "words"),
    [
        # 30 mm is one period of 5 GHz: the far pair alone would take it.
        (np.full((13, 13), 0.31), "are 3[0-9] mm behind the depths from the phases"),
        (np.full((13, 13), 0.25), "are 3[0-9] mm before the depths from the phases"),
        (np.full((13, 13), np.nan), "expected a map with depths on the method's grid"),
        (np.full((13, 12), 0.28), "12 × 13 pixels"),
    ],
)
def test_a_prior_that_is_wrong_as_a_whole_is_refused(tmp_path, prior_m, words):
    with pytest.raises(HandbenchError, match=words):
        found(tmp_path, prior_m)
