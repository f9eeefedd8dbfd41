"""The paper's 2-FSK written out in float64 sums: the strongest pixel corrects the plane once, not
until it stays."""

import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method

C = 299_792_458.0
F1_HZ, F2_HZ = 82.0e9, 81.8e9
FIRST_M, THRESHOLD_DB = 0.45, -10.0
TX_M, RX_M = qar50().tx_m[::8], qar50().rx_m[::8]
ALONG_M = np.arange(-0.02, 0.0201, 0.002)
AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.002}
# Two points, both out of focus at 0.45 m: their common peak leads between them, and the next one to
# the stronger.
POINTS_M = np.array([[-0.01, 0.0, 0.34], [0.012, 0.0, 0.26]])
WEIGHTS = np.array([1.0, 1.4])
EXACTLY_M = 5e-6  # imaging in float32 is worth 1e-5 rad at the threshold, and 119 mm is a radian


def paths_m(points_m):
    """Transmitter to point to receiver, [n, t, r]."""
    to_tx = np.sqrt(((points_m[:, None] - TX_M) ** 2).sum(axis=-1))
    to_rx = np.sqrt(((points_m[:, None] - RX_M) ** 2).sum(axis=-1))
    return to_tx[:, :, None] + to_rx[:, None, :]


def samples(f_hz):
    """Echoes [t, r] of the points."""
    return np.einsum("n,ntr->tr", WEIGHTS, np.exp(-2j * np.pi * f_hz * paths_m(POINTS_M) / C))


def image(f_hz, z_m):
    """The backprojection of every pixel of the plane z_m: O(p) = Σ_t Σ_r S[t, r] exp(+j2πf(|p − t|
    + |p − r|)/c)."""
    x, y = np.meshgrid(ALONG_M, ALONG_M)
    points_m = np.stack([x, y, np.full(x.shape, z_m)], axis=-1).reshape(-1, 3)
    focused = samples(f_hz) * np.exp(2j * np.pi * f_hz * paths_m(points_m) / C)
    return focused.sum(axis=(1, 2)).reshape(x.shape)


def two_fsk(corrections):
    """The planes z_e, and the depths [ny, nx] that the last one tells, NaN below the threshold."""
    z_e = [FIRST_M]
    while True:
        image_1, image_2 = image(F1_HZ, z_e[-1]), image(F2_HZ, z_e[-1])
        amplitude = (np.abs(image_1) + np.abs(image_2)) / 2
        step_m = -C / (4 * np.pi * (F1_HZ - F2_HZ)) * np.angle(image_1 * np.conj(image_2))
        if len(z_e) > corrections:
            seen = 20 * np.log10(amplitude / amplitude.max()) >= THRESHOLD_DB
            return z_e, np.where(seen, z_e[-1] + step_m, np.nan)
        z_e.append(z_e[-1] + step_m[np.unravel_index(amplitude.argmax(), amplitude.shape)])


@pytest.fixture(scope="module")
def capture():
    """The points' echoes at the paper's tones."""
    tones_hz = np.array([F1_HZ, F2_HZ, 79.5e9])
    echoes = np.array([samples(f_hz) for f_hz in tones_hz], np.complex64)
    return RadarCapture(echoes[None], tones_hz, AntennaArray(TX_M, RX_M))


@pytest.fixture
def found(capture):
    """The depth map of a method with its defaults, but for the pixels and the values given."""

    def depth(id, **values):
        return (
            method(id)
            .run(capture, method(id).configure({"x": AXIS, "y": AXIS, **values}, id), 0)
            .depth
        )

    return depth


def off_m(depth, expected_m):
    """The largest difference, infinite where other pixels are on target."""
    if not np.array_equal(np.isfinite(depth.z_m), np.isfinite(expected_m)):
        return np.inf
    return np.nanmax(np.abs(depth.z_m - expected_m))


def test_a_second_correction_would_move_the_plane_far():
    z_e = two_fsk(2)[0]
    assert z_e[1] == pytest.approx(POINTS_M[:, 2].mean(), abs=0.01)
    assert z_e[2] == pytest.approx(POINTS_M[1, 2], abs=0.001)


def test_2fsk_corrects_the_plane_once(found):
    assert off_m(found("2fsk"), two_fsk(1)[1]) < EXACTLY_M
    assert off_m(found("2fsk-settled"), two_fsk(1)[1]) > 1e-3


def test_2fsk_settled_corrects_it_until_it_moves_by_less_than_5_mm(found):
    passes = next(n for n in range(1, 6) if abs(np.diff(two_fsk(n + 1)[0])[-1]) < 0.005)
    assert passes > 1
    settled_m = two_fsk(passes)[1]
    assert off_m(found("2fsk-settled"), settled_m) < EXACTLY_M
    assert off_m(found("2fsk", corrections=passes), settled_m) < EXACTLY_M


def test_the_loop_ends_with_its_corrections(found):
    assert off_m(found("2fsk-settled", corrections=1), two_fsk(1)[1]) < EXACTLY_M
    assert off_m(found("2fsk-settled", corrections=3, settled_m=1e-12), two_fsk(3)[1]) < EXACTLY_M


@pytest.mark.parametrize("id", ["2fsk", "2fsk-settled", "3fsk", "3fsk-settled"])
def test_the_depths_bear_their_predicted_error_and_their_flags(found, id):
    depth = found(id)
    on_target = np.isfinite(depth.z_m)
    assert on_target.any()
    assert (depth.sigma_m[on_target] > 0).all() and np.isnan(depth.sigma_m[~on_target]).all()
    assert depth.wrapped.shape == depth.z_m.shape and not depth.wrapped[~on_target].any()
    # One correction leads to between the points: both are out of focus there, and three tones
    # disagree.
    assert depth.wrapped.any() == (id == "3fsk")
