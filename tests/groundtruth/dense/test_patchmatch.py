"""Windows that bend: second derivatives of the disparity, and what they do for a surface that is
not flat."""

import numpy as np
import pytest

from handbench.groundtruth.dense import patchmatch
from handbench.groundtruth.dense.patchmatch import bends, refine
from handbench.groundtruth.dense.views import Stereo

SIZE = 80
ROW, COLUMN = np.mgrid[:SIZE, :SIZE].astype(float)
INSIDE = np.s_[12:-12, 12:-12]  # four standard deviations of the smoothing from the edges
ALL = np.ones((SIZE, SIZE), bool)


def planes_of(xx=0.0, xy=0.0, yy=0.0, x=0.0, y=0.0):
    """Disparity and its slopes [h, w, 3] of a paraboloid about the middle."""
    dx, dy = COLUMN - SIZE / 2, ROW - SIZE / 2
    disparity = 20 + x * dx + y * dy + (xx * dx**2 + yy * dy**2) / 2 + xy * dx * dy
    return np.stack([disparity, x + xx * dx + xy * dy, y + yy * dy + xy * dx], axis=-1).astype(
        np.float32
    )


@pytest.mark.parametrize("second", [(0.0, 0.0, 0.0), (0.03, 0.01, -0.05)])
def test_a_paraboloid_has_its_second_derivatives(second):
    """Per column², column and row, row²; a symmetric smoothing leaves straight slopes as they are,
    to 32 bits."""
    found = bends(planes_of(*second, x=0.3, y=-0.7), ALL)[INSIDE]
    np.testing.assert_allclose(found, np.broadcast_to(second, found.shape), atol=1e-5)


def texture(u, v):
    """Waves of 4 to 12 pixels in all directions."""
    random = np.random.default_rng(3)
    angle, length, phase = (
        random.uniform(0, np.pi, 40),
        random.uniform(4, 12, 40),
        random.uniform(0, 2 * np.pi, 40),
    )
    k = 2 * np.pi / length
    waves = np.sin(
        np.multiply.outer(u, k * np.cos(angle)) + np.multiply.outer(v, k * np.sin(angle)) + phase
    )
    return (0.5 + 0.05 * waves.sum(axis=-1)).astype(np.float32)


def pictures(xx, yy):
    """A paraboloid's picture, its two sources (shifted sideways and upwards by the disparity) and
    its planes."""
    u, v = np.meshgrid(np.arange(SIZE + 40.0) - SIZE / 2, np.arange(SIZE + 40.0) - SIZE / 2)

    def shifted(u, v, along, across):
        """The reference's u that is shown at u: u + 20 + along u²/2 + across v²/2 there."""
        rest = 20 + across * v**2 / 2 - u
        return -rest if along == 0 else (np.sqrt(np.maximum(1 - 2 * along * rest, 0)) - 1) / along

    sideways = texture(shifted(u, v, xx, yy) + SIZE / 2, v + SIZE / 2)
    upwards = texture(u + SIZE / 2, shifted(v, u, yy, xx) + SIZE / 2)
    return texture(COLUMN, ROW), np.stack([sideways, upwards]), planes_of(xx, 0.0, yy)


def polished_error(xx, yy):
    """Errors of a paraboloid's disparities after polishing from the true planes, in the inside."""
    reference, sources, planes = pictures(xx, yy)
    truth = planes[..., 0].copy()
    low, high = np.full((2, SIZE, SIZE), 5.0), np.full((2, SIZE, SIZE), 40.0)
    A, b = np.tile(np.eye(3), (2, 1, 1)), np.array([(1.0, 0, 0), (0, 1.0, 0)])
    sizes = np.full((2, 2), SIZE + 40)
    refine(Stereo(reference, sources, sizes, A, b, 1.0), planes, low[0], high[0], 0, 0)
    return (planes[..., 0] - truth)[INSIDE]


@pytest.mark.slow
def test_a_flat_window_lies_inside_a_convex_surface_and_a_bent_one_does_not(monkeypatch):
    """A plane under the bilateral window (σ = 3 px, weaker at other tones) is off by half the
    curvature times its mean square, 3 px² in each direction: −0.02 · 3 = −0.06 in all.
    Interpolation leaves 0.002 of it."""
    bent = polished_error(-0.02, -0.02)
    monkeypatch.setattr(patchmatch, "bends", lambda planes, _: np.zeros_like(planes))
    flat = polished_error(-0.02, -0.02)
    assert -0.08 < np.median(flat) < -0.04
    assert abs(np.median(bent)) < 0.01
    assert np.abs(bent).mean() < np.abs(flat).mean()
