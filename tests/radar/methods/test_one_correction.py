"""The paper's 2-FSK written out in float64 sums: the strongest pixel corrects the plane once, not
until it stays."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.imaging.reference import image_points_exact
from tests.radar.direct_sums import direct_echoes
from tests.radar.simulated_points import depth_by, exact_capture

C = 299_792_458.0
TONES_HZ = np.array([82.0e9, 81.8e9, 79.5e9])
ARRAY = AntennaArray(qar50().tx_m[::8], qar50().rx_m[::8])
X, Y = np.meshgrid(*[np.arange(-0.02, 0.0201, 0.002)] * 2)
AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.002}
# Two points, both out of focus at 0.45 m: their common peak leads between them, and the next one to
# the stronger.
POINTS_M, WEIGHTS = np.array([[-0.01, 0.0, 0.34], [0.012, 0.0, 0.26]]), np.array([1.0, 1.4])
EXACTLY_M = 5e-6  # imaging in float32 is worth 1e-5 rad at the threshold, and 119 mm is a radian


def two_fsk(corrections):
    """The planes z_e, and the depths [ny, nx] of the last one, NaN below the threshold."""
    z_e, samples = [0.45], direct_echoes(POINTS_M, WEIGHTS, TONES_HZ, ARRAY)
    while True:
        points_m = np.stack([X, Y, np.full(X.shape, z_e[-1])], axis=-1).reshape(-1, 3)
        image_1, image_2 = (
            image_points_exact(s[None], [f], ARRAY.tx_m, ARRAY.rx_m, points_m).reshape(X.shape)
            for s, f in zip(samples[:2], TONES_HZ[:2], strict=True)
        )
        amplitude = (np.abs(image_1) + np.abs(image_2)) / 2
        step_m = -C / (4 * np.pi * 0.2e9) * np.angle(image_1 * np.conj(image_2))
        if len(z_e) > corrections:
            seen = 20 * np.log10(amplitude / amplitude.max()) >= -10.0
            return z_e, np.where(seen, z_e[-1] + step_m, np.nan)
        z_e.append(z_e[-1] + step_m[np.unravel_index(amplitude.argmax(), amplitude.shape)])


def found(id, **values):
    """The depth map of a method with its defaults, but for the pixels and the values given."""
    taken = exact_capture(POINTS_M, TONES_HZ, WEIGHTS, ARRAY)
    return depth_by(id, taken, {"x": AXIS, "y": AXIS}, **values)


def off_m(depth, expected_m):
    """The largest difference, infinite where other pixels are on target."""
    if not np.array_equal(np.isfinite(depth.z_m), np.isfinite(expected_m)):
        return np.inf
    return np.nanmax(np.abs(depth.z_m - expected_m))


def test_2fsk_corrects_the_plane_once():
    z_e, _ = two_fsk(2)
    assert z_e[1] == pytest.approx(POINTS_M[:, 2].mean(), abs=0.01)
    assert z_e[2] == pytest.approx(POINTS_M[1, 2], abs=0.001)
    once_m = two_fsk(1)[1]
    assert off_m(found("2fsk"), once_m) < EXACTLY_M
    assert off_m(found("2fsk", corrections=2), once_m) > 1e-3


def test_2fsk_corrects_the_plane_as_often_as_configured():
    assert off_m(found("2fsk", corrections=3), two_fsk(3)[1]) < EXACTLY_M
