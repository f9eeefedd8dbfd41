"""Captures that a few lines of Python write, and the methods' settings for their tones."""

import numpy as np
import pytest

import handbench as hb
from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.radar.methods.ability import measured_settings
from tests.refusals import refuse

RNG = np.random.default_rng(3)
TONES_HZ = [72e9, 77e9, 82e9]
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (2, 3)), RNG.uniform(-0.1, 0.1, (4, 3))
SAMPLES = RNG.standard_normal((2, 3, 2, 4, 2)) @ [1, 1j]


def test_an_array(tmp_path):
    times = {"times_s": [0, 1e-3, 2e-3], "frame_times_s": [0, 0.1], "wave_speed_m_s": 2e8}
    about = {"kind": "other", "distance_m": 0.3, "methods": {"2fsk": {"tones_hz": [77e9, 76.8e9]}}}
    hb.save_capture(tmp_path / "out", SAMPLES, TONES_HZ, TX_M, RX_M, **times, **about)
    capture = hb.load(tmp_path / "out")
    assert (capture.name, capture._recorded.about.distance_m) == ("out", 0.3)
    assert isinstance(capture.echoes.aperture, AntennaArray)
    np.testing.assert_array_equal(capture.echoes.samples, SAMPLES.astype(np.complex64))
    np.testing.assert_array_equal(capture.echoes.aperture.rx_m, RX_M)
    assert capture.echoes.frame_times_s.tolist() == [0, 0.1]
    assert capture.echoes.wave_speed_m_s == 2e8


def test_pairs_and_a_scan(tmp_path):
    pairs = [[0, 1], [1, 3]]
    hb.save_capture(tmp_path / "pairs", SAMPLES[..., 0], TONES_HZ, TX_M, RX_M, pairs=pairs)
    echoes = hb.load(tmp_path / "pairs").echoes
    assert np.argwhere(echoes.aperture.measured).tolist() == pairs
    np.testing.assert_allclose(echoes.samples[:, :, [0, 1], [1, 3]], SAMPLES[..., 0], rtol=1e-6)
    scan = hb.save_capture(tmp_path / "scan", SAMPLES[:, :, 0], TONES_HZ, position_m=RX_M)
    assert isinstance(scan.echoes.aperture, AntennaPairs)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"rx_m": None}, "rx_m"),
        ({"position_m": RX_M}, "position_m"),
        ({"tx_m": TX_M[:, :2]}, "tx_m"),
        ({"distance_mm": 300}, "distance_mm"),
        ({"samples": SAMPLES.astype(object)}, "samples"),
        ({"tx_m": np.ma.masked_equal(TX_M, TX_M[0, 0])}, "tx_m"),
        ({"samples": np.ma.masked_equal(SAMPLES, SAMPLES[0, 0, 0, 0])}, "samples"),
        ({"folder": "."}, "exists"),
        ({"folder": "a\0b"}, "a"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, change, place):
    given = {"samples": SAMPLES, "frequencies_hz": TONES_HZ, "tx_m": TX_M, "rx_m": RX_M} | change
    folder = tmp_path / given.pop("folder", "out")
    refuse(lambda: hb.save_capture(folder, **given), place)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("tones_ghz", "methods"),
    [
        ([72.0], []),
        ([72.0, 72.2], ["2fsk", "broadband"]),
        ([72.0, 80.0, 82.0], ["2fsk", "3fsk"]),
        ([72.0, 77.0, 82.0], ["2fsk", "3fsk", "broadband"]),
    ],
)
def test_settings_for_few_tones(tones_ghz, methods):
    assert sorted(measured_settings(1e9 * np.array(tones_ghz))) == methods


def test_settings_for_an_even_sweep():
    chosen = measured_settings(np.linspace(72e9, 82e9, 101))
    assert chosen["3fsk"] == {
        "tones_hz": [82e9, 81.8e9, pytest.approx(79.6e9, abs=1e8)],
        "first_depth_m": "auto",
    }
    sweep = {"start_hz": 72e9, "stop_hz": 82e9, "count": 101}
    assert chosen["broadband"] == {"tones_hz": sweep}
