"""Captures of any kind by `echoes.h5`: a file of version 2 becomes the capture that version 1 would
hold."""

import h5py
import numpy as np
import pytest

from handbench.calibration.array.array_file import ArrayCalibration, Side, with_calibration
from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.data.recording import SPARSE
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json

RNG = np.random.default_rng(7)
T, R, TONES_HZ = 3, 4, np.linspace(72e9, 82e9, 5)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (T, 3)), RNG.uniform(-0.1, 0.1, (R, 3))
SAMPLES = (RNG.standard_normal((2, 5, T, R, 2)) @ [1, 1j]).astype(np.complex64)
EVERY = np.argwhere(np.ones((T, R), bool))
STATED = {"units": "m, Hz, m/s", "frame": "x left, y up, z away", "time": "+jwt"}


def written(path, attributes=(), version=2, **data):
    """A file by h5py alone, as a stranger writes it; a data set of None is left out."""
    content = {"samples": SAMPLES, "frequencies_hz": TONES_HZ, "tx_m": TX_M, "rx_m": RX_M} | data
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "handbench-echoes", version
        file.attrs.update((STATED if version == 2 else {}) | dict(attributes))
        for name, values in content.items():
            if values is not None:
                file[name] = values
    return path


def loaded(tmp_path, attributes=(), **data):
    return load_capture(written(tmp_path / "echoes.h5", attributes, **data))


def test_versions_of_the_same_echoes_are_the_same_capture(tmp_path):
    first = loaded(tmp_path, version=1)
    shuffled = RNG.permutation(EVERY)
    by_pair = SAMPLES[:, :, shuffled[:, 0], shuffled[:, 1]]
    turned = {"time": "-jwt", "frame": "x right, y up, z away"}
    mirrored = {"tx_m": TX_M * [-1, 1, 1], "rx_m": RX_M * [-1, 1, 1]}
    for other in (
        loaded(tmp_path),
        loaded(tmp_path, samples=by_pair, pairs=shuffled),
        loaded(tmp_path, turned, samples=SAMPLES.conj(), **mirrored),
    ):
        np.testing.assert_array_equal(other.samples, first.samples)
        np.testing.assert_array_equal(other.frequencies_hz, first.frequencies_hz)
        for name in ("tx_m", "rx_m"):
            np.testing.assert_array_equal(
                getattr(other.aperture, name), getattr(first.aperture, name)
            )
        assert other.aperture.measured is None


def test_pairs_that_were_not_measured_are_zeros_that_are_known(tmp_path):
    there = np.ones((T, R), bool)
    there[0, 1] = there[2, 3] = False
    listed = loaded(tmp_path, samples=SAMPLES[:, :, there], pairs=np.argwhere(there))
    blank = loaded(tmp_path, samples=np.where(there, SAMPLES, np.nan))
    gains = loaded(tmp_path, gains=there.astype(np.complex64))
    for capture in (listed, blank, gains):
        np.testing.assert_array_equal(capture.aperture.measured, there)
        np.testing.assert_array_equal(capture.samples, np.where(there, SAMPLES, 0))
    with pytest.raises(
        HandbenchError, match="1 of 120 are NaN or infinite"
    ):  # a channel with one bad tone
        loaded(
            tmp_path, samples=np.where(np.arange(120).reshape(SAMPLES.shape) == 3, np.nan, SAMPLES)
        )


def test_samples_are_divided_by_gains(tmp_path):
    by_channel, by_tone = (
        np.exp(1j * RNG.uniform(-3, 3, (T, R))),
        RNG.uniform(1, 2, (5, T, R)) * (1 + 0.2j),
    )
    for gains in (by_channel, by_tone):
        capture = loaded(
            tmp_path, {"time": "-jwt"}, samples=(SAMPLES * gains).conj(), gains=gains.conj()
        )
        np.testing.assert_allclose(capture.samples, SAMPLES, rtol=1e-6)  # single precision


def test_repeated_sweeps_are_averaged_or_become_frames(tmp_path):
    sweeps = np.stack([SAMPLES + 1, SAMPLES - 1, SAMPLES], axis=1)
    failed = np.where(np.arange(36).reshape(1, 3, 1, T, R) == 5, np.nan, sweeps)
    with pytest.raises(HandbenchError, match="10 of 120 are NaN"):
        loaded(tmp_path, {"sweeps": "mean"}, samples=failed)
    mean = loaded(tmp_path, {"sweeps": "mean"}, samples=sweeps)
    np.testing.assert_allclose(mean.samples, SAMPLES, atol=1e-6)
    frames = loaded(tmp_path, {"sweeps": "frames"}, samples=sweeps)
    np.testing.assert_array_equal(frames.samples, sweeps.reshape(6, *SAMPLES.shape[1:]))


def test_a_short_list_of_pairs_is_no_array(tmp_path):
    """An array of both antennas' places would have SPARSE times as many pairs, or more."""
    n = SPARSE + 1
    places = RNG.uniform(-0.1, 0.1, (n, 3))
    together = {
        "tx_m": places,
        "rx_m": places + [0.01, 0, 0],
        "pairs": np.repeat(np.arange(n)[:, None], 2, axis=1),
    }
    samples = (RNG.standard_normal((1, 5, n, 2)) @ [1, 1j]).astype(np.complex64)
    capture = loaded(tmp_path, samples=samples, **together)
    assert isinstance(capture.aperture, AntennaPairs)
    np.testing.assert_array_equal(capture.aperture.rx_m, places + [0.01, 0, 0])
    np.testing.assert_array_equal(thin_antennas(capture, 2).samples, samples[..., ::2])
    fewer = {name: values[:-1] for name, values in together.items()}
    assert isinstance(loaded(tmp_path, samples=samples[..., :-1], **fewer).aperture, AntennaArray)


def test_a_scan_without_some_of_its_positions(tmp_path):
    position_m, samples = RNG.uniform(-0.1, 0.1, (6, 3)), np.ones((1, 5, 6), np.complex64)
    samples[..., 2] = np.nan
    capture = loaded(tmp_path, samples=samples, position_m=position_m, tx_m=None, rx_m=None)
    assert capture.samples.shape == (1, 5, 5)
    np.testing.assert_array_equal(capture.aperture.tx_m, np.delete(position_m, 2, axis=0))


MEASURED = np.arange(T * R).reshape(T, R) % 3 > 0


@pytest.mark.parametrize(
    "capture",
    [
        RadarCapture(SAMPLES, TONES_HZ, AntennaArray(TX_M, RX_M)),
        RadarCapture(SAMPLES[..., 0], TONES_HZ, AntennaPairs(TX_M, TX_M)),
        RadarCapture(np.where(MEASURED, SAMPLES, 0), TONES_HZ, AntennaArray(TX_M, RX_M, MEASURED)),
        RadarCapture(
            np.tile(SAMPLES[..., 0], 6), TONES_HZ, AntennaPairs(*RNG.uniform(size=(2, 18, 3)))
        ),
        RadarCapture(
            SAMPLES,
            TONES_HZ,
            AntennaArray(TX_M, RX_M),
            2e8,
            "a laboratory",
            "CC BY 4.0",
            {"tx": [1]},
        ),
    ],
)
def test_what_was_saved_comes_back(tmp_path, capture):
    save_capture(tmp_path / "echoes.h5", capture)
    back = load_capture(tmp_path / "echoes.h5")
    for name in ("samples", "frequencies_hz", "wave_speed_m_s", "source", "licence", "calibration"):
        np.testing.assert_array_equal(getattr(back, name), getattr(capture, name))
    assert type(back.aperture) is type(capture.aperture)
    for name, values in vars(capture.aperture).items():
        np.testing.assert_array_equal(getattr(back.aperture, name), values)


def test_thinning_keeps_what_was_measured():
    capture = RadarCapture(
        np.where(MEASURED, SAMPLES, 0), TONES_HZ, AntennaArray(TX_M, RX_M, MEASURED)
    )
    np.testing.assert_array_equal(thin_antennas(capture, 2).aperture.measured, MEASURED[::2, ::2])


def array_calibration(tx_m: np.ndarray, rx_m: np.ndarray) -> ArrayCalibration:
    """The calibration of an array whose antennas all have the same errors."""

    def side(places_m: np.ndarray) -> Side:
        n = len(places_m)
        return Side(nominal_m=places_m.tolist(), gain=[(1.0, 0.1)] * n, delay_m=[1e-4] * n)

    return ArrayCalibration(source="target", reference_hz=77e9, tx=side(tx_m), rx=side(rx_m))


def test_the_array_s_calibration_lies_inside(tmp_path):
    """The samples of the inner file are those of the one beside; without either, nothing is
    applied."""
    calibration = array_calibration(TX_M, RX_M)
    write_json(tmp_path / "array.json", calibration.model_dump())
    there = np.argwhere(MEASURED)
    content = np.frombuffer((tmp_path / "array.json").read_bytes(), np.uint8)
    samples = SAMPLES[:, :, MEASURED]
    bare = loaded(tmp_path, samples=samples, pairs=there)
    inside = loaded(tmp_path, samples=samples, pairs=there, **{"array.json": content})
    beside, note = with_calibration(bare, tmp_path / "array.json")
    within, other = with_calibration(inside, tmp_path / "none" / "array.json")
    assert note.endswith(other.split("applied")[1]) and within.calibration is None
    np.testing.assert_array_equal(within.samples, beside.samples)
    np.testing.assert_array_equal(within.aperture.measured, MEASURED)
    assert with_calibration(bare, tmp_path / "none" / "array.json") == (bare, "")
    empty = loaded(tmp_path, **{"array.json": np.frombuffer(b"[]", np.uint8)})
    with pytest.raises(HandbenchError, match=r"array\.json inside its echoes: .*valid dictionary"):
        with_calibration(empty, tmp_path / "none" / "array.json")


@pytest.mark.parametrize(
    ("attributes", "data", "reason"),
    [
        ({}, {"tx_m": None, "samples": None}, "key 'samples' is missing; add it"),
        ({}, {"gain": np.ones((T, R))}, "unknown key 'gain'; did you mean 'gains'?"),
        ({"time": "jwt"}, {}, r"'time' is 'jwt'; .* '\+jwt' or '-jwt'"),
        (
            {"sweeps": "median"},
            {"samples": SAMPLES[:, None]},
            "'sweeps' is 'median'; .* 'mean' or 'frames'",
        ),
        (
            {"sweeps": "mean"},
            {},
            r"samples: have shape \(2, 5, 3, 4\); expected \[frame, sweep, 5, 3, 4\]",
        ),
        ({}, {"times_s": np.zeros(4)}, r"times_s: is float64 of shape \(4,\); expected 5 finite"),
        ({}, {"times_s": np.full(5, np.nan)}, "times_s: .*expected 5 finite numbers"),
        ({}, {"frame_times_s": np.zeros(2)}, "frame_times_s: are not ascending"),
        ({"wave_speed_m_s": "fast"}, {}, "valid number"),
        ({"wave_speed_m_s": np.nan}, {}, "'wave_speed_m_s' is"),
        (
            {},
            {"gains": np.ones((T, R + 1))},
            r"gains: have shape \(3, 5\); expected \(3, 4\), or \(5, 3, 4\) with gains",
        ),
        ({}, {"pairs": EVERY}, r"samples: have shape \(2, 5, 3, 4\); expected \[frame, 5, 12\]"),
        (
            {},
            {"pairs": EVERY + 1, "samples": SAMPLES.reshape(2, 5, -1)},
            "pairs: .* whole numbers: a transmitter from 0 to 2",
        ),
        (
            {},
            {"pairs": EVERY * 0, "samples": SAMPLES.reshape(2, 5, -1)},
            "pairs: 11 rows repeat an earlier pair",
        ),
        ({}, {"position_m": TX_M}, "has position_m, rx_m, tx_m; expected the data sets tx_m"),
        ({}, {"array.json": np.frombuffer(b"{", np.uint8)}, "not a readable echoes.h5"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, attributes, data, reason):
    with pytest.raises(HandbenchError, match=reason) as caught:
        loaded(tmp_path, attributes, **data)
    assert "\n" not in str(caught.value) and str(caught.value).startswith(
        str(tmp_path / "echoes.h5")
    )


def test_texts_of_fixed_length_are_texts(tmp_path):
    """MATLAB's h5writeatt writes them so."""
    fixed = {name: np.bytes_(value) for name, value in STATED.items()} | {
        "licence": np.bytes_("CC0-1.0")
    }
    assert loaded(tmp_path, fixed | {"version": np.float64(2)}).licence == "CC0-1.0"


@pytest.mark.parametrize("version", (1, 2))
def test_times_of_tones_and_frames_are_kept_and_a_repeated_tone_is_its_earliest(tmp_path, version):
    hz = np.array([79.5e9, 82e9, 81.8e9, 82e9, 81.0e9])
    times_s, frame_times_s = np.array([2e-3, 3e-3, 1e-3, 0.0, 4e-3]), np.array([0.0, 0.1])
    written_ = {"frequencies_hz": hz, "times_s": times_s, "frame_times_s": frame_times_s}
    first = loaded(tmp_path, version=version, **written_)
    save_capture(tmp_path / "again.h5", first)
    for capture in (first, load_capture(tmp_path / "again.h5")):
        np.testing.assert_array_equal(capture.times_s, times_s)
        np.testing.assert_array_equal(capture.frame_times_s, frame_times_s)
        np.testing.assert_array_equal(capture.tone_index([82e9, 79.5e9]), [3, 0])
        np.testing.assert_array_equal(capture.first_frames(1).frame_times_s, [0.0])
    without = loaded(tmp_path, frequencies_hz=hz, version=version)
    assert without.times_s is None and without.tone_index([82e9])[0] == 1
