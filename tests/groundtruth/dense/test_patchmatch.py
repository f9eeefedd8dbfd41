"""Planes that are smoothed along the surface, and the second derivatives of the disparity."""

import numpy as np
import pytest

from handbench.groundtruth.dense.patchmatch import APART_PX, smoothed

SIZE = 80
ROW, COLUMN = np.mgrid[:SIZE, :SIZE].astype(float)
SECOND = (0.03, 0.01, -0.05)  # per column², column and row, row²
DISC = np.hypot(ROW - SIZE / 2, COLUMN - SIZE / 2) < 20
EVERYWHERE = np.ones((SIZE, SIZE), bool)


def planes_of(xx, xy, yy):
    """Disparity and its slopes [3, h, w] of a paraboloid about the middle."""
    dx, dy = COLUMN - SIZE / 2, ROW - SIZE / 2
    disparity = 20 + 0.3 * dx - 0.7 * dy + (xx * dx**2 + yy * dy**2) / 2 + xy * dx * dy
    return np.stack([disparity, 0.3 + xx * dx + xy * dy, -0.7 + yy * dy + xy * dx]).astype(
        np.float32
    )


@pytest.mark.parametrize("second", [(0.0, 0.0, 0.0), SECOND])
@pytest.mark.parametrize(
    ("seen", "beside"),
    [(EVERYWHERE, "nothing"), (DISC, "unmatched"), (DISC, "apart")],
    ids=["everywhere", "disc-unmatched", "disc-apart"],
)
def test_a_paraboloid_is_found_up_to_its_border(second, seen, beside):
    """Also beside another surface, which is further away than APART_PX and not bent. Rounding:
    disparities of some tens have 4e-6, slopes of some units less."""
    true, matched = planes_of(*second), seen.copy()
    planes = np.where(seen, true, np.float32([-50, 0, 0])[:, None, None])
    if beside == "apart":
        matched[:] = True
    found, bends, _ = smoothed(planes, matched)
    for bend, value in zip(bends, second, strict=True):
        np.testing.assert_allclose(bend[seen], value, atol=2e-5)
    np.testing.assert_allclose(found[:, seen], true[:, seen], atol=1e-4)
    assert np.abs(true[0, DISC] + 50).min() > APART_PX


def test_noise_of_planes_is_averaged():
    """White noise of the planes; 1500 pixels, of which those 16 pixels apart are independent, know
    a standard deviation to a tenth. The mean over Gaussian weights of 3 pixels, every second one,
    has √(4/(4π 3²)) = 0.19 of it; the slopes' share of the disparity, 3 pixels times as much."""
    draws, sigma = np.random.default_rng(3), 0.02
    noisy = planes_of(0.0, 0.0, 0.0)
    clean = noisy.copy()
    noisy[1:] += sigma * draws.standard_normal((2, SIZE, SIZE)).astype(np.float32)
    found, _, _ = smoothed(noisy, EVERYWHERE)
    off = (found - clean)[1:, 12:-12, 12:-12].std()
    assert 0.1 * sigma < off < 0.25 * sigma
