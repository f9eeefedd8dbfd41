"""Captures of any kind by `echoes.h5`: a file of version 2 becomes the capture that version 1 would
hold."""

import h5py
import numpy as np
import pytest

from handbench.calibration.array_file import ArrayCalibration, Side, with_calibration
from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import SPARSE, RadarCapture, thin_antennas
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from tests.refusals import refuse

RNG = np.random.default_rng(7)
T, R, TONES_HZ = 3, 4, np.linspace(72e9, 82e9, 5)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (T, 3)), RNG.uniform(-0.1, 0.1, (R, 3))
SAMPLES = (RNG.standard_normal((2, 5, T, R, 2)) @ [1, 1j]).astype(np.complex64)
LISTED = SAMPLES.reshape(2, 5, -1)
UNWRITTEN = {"shape": SAMPLES.shape, "dtype": "c8", "chunks": (1, *SAMPLES.shape[1:])}
NUMBER = np.arange(SAMPLES.size).reshape(SAMPLES.shape)
EVERY = np.argwhere(np.ones((T, R), bool))
MEASURED = np.arange(T * R).reshape(T, R) % 3 > 0
SOME = AntennaArray(TX_M, RX_M, MEASURED)
STATED = {"units": "m, Hz, m/s", "frame": "x left, y up, z away", "time": "+jwt"}


def written(path, attributes=(), version=2, **data):
    """A file by h5py alone, as a stranger writes it; a data set of None is left out, and a
    dictionary has the arguments of h5py."""
    content = {"samples": SAMPLES, "frequencies_hz": TONES_HZ, "tx_m": TX_M, "rx_m": RX_M} | data
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "handbench-echoes", version
        file.attrs.update((STATED if version == 2 else {}) | dict(attributes))
        for name, values in content.items():
            if isinstance(values, dict):
                file.create_dataset(name, **values)
            elif values is not None:
                file[name] = values
    return path


def loaded(tmp_path, attributes=(), **data):
    return load_capture(written(tmp_path / "echoes.h5", attributes, **data))


def content(capture):
    """All that a capture holds, by name."""
    kind = {"aperture": type(capture.aperture)}
    return vars(capture) | vars(capture.aperture) | kind


def test_versions_of_the_same_echoes_are_the_same_capture(tmp_path):
    """MATLAB's h5writeatt writes texts of fixed length."""
    shuffled = RNG.permutation(EVERY)
    by_pair = SAMPLES[:, :, shuffled[:, 0], shuffled[:, 1]]
    turned = {"time": "-jwt", "frame": "x right, y up, z away"}
    mirrored = {"tx_m": TX_M * [-1, 1, 1], "rx_m": RX_M * [-1, 1, 1]}
    fixed = {name: np.bytes_(text) for name, text in STATED.items()} | {"version": np.float64(2)}
    for other in (
        loaded(tmp_path),
        loaded(tmp_path, fixed),
        loaded(tmp_path, samples=by_pair, pairs=shuffled),
        loaded(tmp_path, turned, samples=SAMPLES.conj(), **mirrored),
    ):
        np.testing.assert_equal(content(other), content(loaded(tmp_path, version=1)))


def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path):
    """HDF5 has checksums of all that a file holds, but not of the gaps in it."""
    whole, file = loaded(tmp_path), tmp_path / "echoes.h5"
    save_capture(file, whole)
    stored = file.read_bytes()
    for bit in map(int, RNG.integers(8 * len(stored), size=30)):
        flipped = bytearray(stored)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        try:
            np.testing.assert_equal(content(load_capture(file)), content(whole))
        except HandbenchError as refusal:
            assert str(file) in str(refusal)


def test_pairs_that_were_not_measured_are_zeros_that_are_known(tmp_path):
    listed = loaded(tmp_path, samples=SAMPLES[:, :, MEASURED], pairs=np.argwhere(MEASURED))
    blank = loaded(tmp_path, samples=np.where(MEASURED, SAMPLES, np.nan))
    gains = loaded(tmp_path, gains=MEASURED.astype(np.complex64))
    for capture in (listed, blank, gains):
        np.testing.assert_array_equal(capture.aperture.measured, MEASURED)
        np.testing.assert_array_equal(capture.samples, np.where(MEASURED, SAMPLES, 0))


@pytest.mark.parametrize("tones", [(), (5,)], ids=["by channel", "by tone"])
def test_samples_are_divided_by_gains(tmp_path, tones):
    gains = RNG.uniform(1, 2, (*tones, T, R)) * np.exp(1j * RNG.uniform(-3, 3, (T, R)))
    received = (SAMPLES * gains).conj()
    capture = loaded(tmp_path, {"time": "-jwt"}, samples=received, gains=gains.conj())
    np.testing.assert_allclose(capture.samples, SAMPLES, rtol=1e-6)  # single precision


def test_repeated_sweeps_are_averaged_or_become_frames(tmp_path):
    sweeps = np.stack([SAMPLES + 1, SAMPLES - 1, SAMPLES], axis=1)
    mean = loaded(tmp_path, {"sweeps": "mean"}, samples=sweeps)
    np.testing.assert_allclose(mean.samples, SAMPLES, atol=1e-6)  # single precision
    frames = loaded(tmp_path, {"sweeps": "frames"}, samples=sweeps)
    np.testing.assert_array_equal(frames.samples, sweeps.reshape(6, *SAMPLES.shape[1:]))


@pytest.mark.parametrize(("count", "kind"), [(SPARSE + 1, AntennaPairs), (SPARSE, AntennaArray)])
def test_a_short_list_of_pairs_is_no_array(tmp_path, count, kind):
    """An array of both antennas' places would have SPARSE times as many pairs, or more."""
    places_m = RNG.uniform(-0.1, 0.1, (count, 3))
    pairs = np.repeat(np.arange(count)[:, None], 2, axis=1)
    samples = np.ones((1, 5, count), np.complex64)
    capture = loaded(tmp_path, samples=samples, tx_m=places_m, rx_m=places_m + 0.01, pairs=pairs)
    assert isinstance(capture.aperture, kind)
    np.testing.assert_array_equal(capture.aperture.rx_m, places_m + 0.01)


def test_a_scan_without_some_of_its_positions(tmp_path):
    position_m, samples = RNG.uniform(-0.1, 0.1, (6, 3)), np.ones((1, 5, 6), np.complex64)
    samples[..., 2] = np.nan
    capture = loaded(tmp_path, samples=samples, position_m=position_m, tx_m=None, rx_m=None)
    assert capture.samples.shape == (1, 5, 5)
    np.testing.assert_array_equal(capture.aperture.tx_m, np.delete(position_m, 2, axis=0))


TIMES_S = np.array([2e-3, 3e-3, 1e-3, 0.0, 4e-3])
REPEATED = RadarCapture(
    np.where(MEASURED, SAMPLES, 0),
    np.array([79.5e9, 82e9, 81.8e9, 82e9, 81.0e9]),
    SOME,
    2e8,
    "a laboratory",
    "CC BY 4.0",
    {"tx": [1]},
    TIMES_S,
    np.array([0.0, 0.1]),
)
SCAN = RadarCapture(SAMPLES[..., 0], TONES_HZ, AntennaPairs(TX_M, TX_M))


@pytest.mark.parametrize(
    "capture",
    [
        RadarCapture(SAMPLES, TONES_HZ, AntennaArray(TX_M, RX_M)),
        REPEATED,
        SCAN,
        RadarCapture(LISTED, TONES_HZ, AntennaPairs(*RNG.uniform(size=(2, T * R, 3)))),
    ],
)
def test_what_was_saved_comes_back(tmp_path, capture):
    save_capture(tmp_path / "echoes.h5", capture)
    np.testing.assert_equal(content(load_capture(tmp_path / "echoes.h5")), content(capture))


def test_thinning_keeps_what_was_measured():
    thin = thin_antennas(REPEATED, 2)
    np.testing.assert_array_equal(thin.samples, REPEATED.samples[..., ::2, ::2])
    np.testing.assert_array_equal(thin.aperture.measured, MEASURED[::2, ::2])
    thin = thin_antennas(SCAN, 2)
    np.testing.assert_array_equal(thin.samples, SCAN.samples[..., ::2])
    np.testing.assert_array_equal(thin.aperture.tx_m, TX_M[::2])


def test_tones_are_the_nearest_measured_ones_with_their_true_frequencies():
    capture = RadarCapture(SAMPLES, TONES_HZ, AntennaArray(TX_M, RX_M))
    samples, tones_hz = capture.tones([74.4e9, 82e9])
    assert tones_hz.tolist() == [74.5e9, 82e9]
    np.testing.assert_array_equal(samples, SAMPLES[0, [1, 4]])
    refuse(lambda: capture.tones([60e9]), "60.0000 GHz")
    refuse(lambda: capture.tones([74.4e9, 74.6e9]), "frequencies")


def test_a_repeated_tone_is_its_earliest():
    assert REPEATED.tone_index([82e9, 79.5e9]).tolist() == [3, 0]
    assert REPEATED.first_frames(1).frame_times_s.tolist() == [0]


def test_the_array_s_calibration_lies_inside(tmp_path):
    """The samples of the inner file are those of the one beside; without either, nothing is
    applied."""
    tx, rx = (
        Side(nominal_m=ends_m.tolist(), gain=[(1.0, 0.1)] * n, delay_m=[1e-4] * n)
        for ends_m, n in ((TX_M, T), (RX_M, R))
    )
    calibration = ArrayCalibration(source="target", reference_hz=77e9, tx=tx, rx=rx)
    write_json(tmp_path / "array.json", calibration.model_dump())
    inner = np.frombuffer((tmp_path / "array.json").read_bytes(), np.uint8)
    bare, inside = loaded(tmp_path), loaded(tmp_path, **{"array.json": inner})
    beside, _ = with_calibration(bare, tmp_path / "array.json")
    within, _ = with_calibration(inside, tmp_path / "none" / "array.json")
    assert within.calibration is None
    assert np.abs(within.samples - bare.samples).max() > 0.1
    np.testing.assert_array_equal(within.samples, beside.samples)
    assert with_calibration(bare, tmp_path / "none" / "array.json") == (bare, "")
    empty = loaded(tmp_path, **{"array.json": np.frombuffer(b"[]", np.uint8)})
    refuse(lambda: with_calibration(empty, tmp_path / "none" / "array.json"), "array.json")


@pytest.mark.parametrize(
    ("attributes", "data", "place"),
    [
        ({}, {"samples": None}, "'samples'"),
        ({}, {"samples": SAMPLES * np.nan}, "samples"),
        ({}, {"samples": np.where(NUMBER == 3, np.nan, SAMPLES)}, "1 of 120"),
        ({"sweeps": "mean"}, {"samples": np.where(NUMBER == 3, np.nan, SAMPLES)[:, None]}, "120"),
        ({"sweeps": "mean"}, {}, "[frame, sweep, 5, 3, 4]"),
        ({}, {"samples": {"shape": (1, 5, T, 10**13), "dtype": "c8", "chunks": (1, 5, T, R)}}, ""),
        ({}, {"samples": UNWRITTEN | {"fletcher32": True}}, "chunks"),
        ({}, {"gain": np.ones((T, R))}, "'gains'"),
        ({}, {"gains": np.ones((T, R + 1))}, "(3, 5)"),
        ({"time": "jwt"}, {}, "'time'"),
        ({}, {"times_s": np.zeros(4)}, "times_s"),
        ({}, {"times_s": np.full(5, np.nan)}, "times_s"),
        ({}, {"frame_times_s": np.zeros(2)}, "frame_times_s"),
        ({"wave_speed_m_s": np.nan}, {}, "wave_speed_m_s"),
        ({}, {"frequencies_hz": -TONES_HZ}, "frequencies_hz"),
        ({}, {"tx_m": TX_M[:, :2]}, "(3, 2)"),
        ({}, {"pairs": EVERY + 1, "samples": LISTED}, "from 0 to 2"),
        ({}, {"pairs": EVERY * 0, "samples": LISTED}, "11 rows"),
        ({}, {"tx_m": None}, "tx_m"),
        ({}, {"position_m": TX_M}, "position_m"),
        ({}, {"array.json": np.frombuffer(b"{", np.uint8)}, ""),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, attributes, data, place):
    refuse(lambda: loaded(tmp_path, attributes, **data), str(tmp_path / "echoes.h5"), place)


def test_what_a_recorder_did_not_write_is_zero(tmp_path):
    assert not loaded(tmp_path, samples=UNWRITTEN).samples.any()


@pytest.mark.parametrize(
    "samples",
    [
        h5py.ExternalLink("other.h5", "samples"),
        h5py.SoftLink("/whole/samples"),
        {"shape": SAMPLES.shape, "dtype": "c8", "external": [("other.h5", 0, SAMPLES.nbytes)]},
    ],
)
def test_a_file_reaches_into_no_other(tmp_path, samples, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "other.h5")
    data = {"samples": samples, "whole": h5py.ExternalLink("other.h5", "/")}
    refuse(lambda: loaded(tmp_path, **data), "echoes.h5", "'samples'")


@pytest.mark.parametrize(("scale", "place"), [(1e300, "e+300"), (1e-300, "e-300")])
def test_samples_that_a_file_cannot_hold_are_refused(scale, place, tmp_path):
    capture = RadarCapture(SAMPLES.astype(complex) * scale, TONES_HZ, AntennaArray(TX_M, RX_M))
    refuse(lambda: save_capture(tmp_path / "echoes.h5", capture), "samples", place)
    assert not (tmp_path / "echoes.h5").exists()


def test_the_built_in_array_is_the_paper_s():
    array = qar50()
    assert array.channels == (94, 94)
    assert np.abs(np.concatenate([array.tx_m, array.rx_m])[:, :2]).max() <= 0.072
    np.testing.assert_allclose(np.diff(array.rx_m[:47, 0]), 0.003)
