"""Depths about another sensor's: a sphere's cap in closed form, priors that are noisy, wrong or not
of these pixels."""

import numpy as np
import pytest

from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.radar.methods.test_joint import around, point_capture

AT_M = (0.02, -0.01, 0.28)
X_M, Y_M = (at + np.arange(-6, 7) * 1e-3 for at in AT_M[:2])


def found(tmp_path, z_m, **more):
    """The depth map about a prior of one scatterer."""
    chosen, path = method("prior-2fsk"), tmp_path / "prior.npz"
    DepthMap(X_M, Y_M, z_m, np.zeros_like(z_m), "kinect").save(path)
    config = chosen.configure(around(AT_M, prior=str(path), **more), "test")
    return chosen.run(point_capture(AT_M, [82e9, 81.8e9, 77e9]), config, 0).depth


def test_a_prior_of_five_millimetres_leaves_nothing_of_its_error(tmp_path):
    """0.02 mm in the scatterer's pixel, whatever the prior's error: it is one depth, and noise has
    none in it."""
    prior_m = AT_M[2] + 5e-3 * np.random.default_rng(1).uniform(-1, 1, (13, 13))
    depth = found(tmp_path, prior_m, fine_filter_px=1, edge_m=0.0)
    assert depth.z_m[6, 6] == pytest.approx(AT_M[2], abs=2e-5) and not depth.wrapped[6, 6]


def test_a_prior_that_is_wrong_as_a_whole_is_refused(tmp_path):
    """30 mm is one period of 5 GHz: the far pair alone would take it."""
    for off_m, side in ((0.03, "behind"), (-0.03, "before")):
        with pytest.raises(
            HandbenchError, match=f"lies 3[0-9] mm {side} the depths that close tones tell"
        ):
            found(tmp_path, np.full((13, 13), AT_M[2] + off_m))


def test_a_part_that_is_wrong_is_flagged(tmp_path):
    """The outer columns of the lobe 30 mm off: flagged there or dropped, and not in the middle."""
    prior_m = np.full((13, 13), AT_M[2])
    prior_m[:, 8:] += 0.03
    depth = found(tmp_path, prior_m, drop_doubtful=False, fine_filter_px=1)
    seen = np.isfinite(depth.z_m)
    assert depth.wrapped[seen & (np.arange(13) >= 8)].all() and not depth.wrapped[5:8, 5:7].any()


def test_a_prior_of_other_pixels_is_refused(tmp_path):
    with pytest.raises(HandbenchError, match="expected depths on the method's x and y"):
        found(tmp_path, np.full((13, 13), np.nan))
    path = tmp_path / "small.npz"
    DepthMap(X_M[1:], Y_M, np.full((13, 12), 0.28), np.zeros((13, 12)), "kinect").save(path)
    chosen = method("prior-2fsk")
    with pytest.raises(HandbenchError, match="12 × 13 pixels"):
        config = chosen.configure(around(AT_M, prior=str(path)), "test")
        chosen.run(point_capture(AT_M, [82e9, 81.8e9, 77e9]), config, 0)


def test_a_witness_too_far_away_is_refused():
    with pytest.raises(HandbenchError, match="close_hz is no witness"):
        method("prior-2fsk").configure({"close_hz": 79e9}, "config")
