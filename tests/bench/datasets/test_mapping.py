"""Echoes in somebody else's HDF5 file: every way of writing them down gives the same capture, all
else is refused."""

import h5py
import numpy as np
import pytest
import tomlkit
from scipy.io import savemat

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import MAPPING
from handbench.radar.data.arrays import AntennaArray
from handbench.support.errors import HandbenchError

RNG = np.random.default_rng(4)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (3, 3)), RNG.uniform(-0.1, 0.1, (4, 3))
TONES_HZ = np.linspace(72e9, 82e9, 5)
SAMPLES = (RNG.standard_normal((2, 5, 3, 4)) + 1j * RNG.standard_normal((2, 5, 3, 4))).astype(
    np.complex64
)


def mapping(**samples) -> dict:
    """A mapping of the file that `matlab` writes, with what differs of its samples."""
    positions = {"unit": "mm", "reversed": True, "x": "right"}
    axes = ["rx", "tx", "frequency", "frame"]
    return {
        "version": 1,
        "file": "hand.mat",
        "capture": {"name": "hand", "distance_m": 0.3},
        "samples": {"dataset": "xr", "axes": axes, "reversed": True, "sign": "+"} | samples,
        "frequencies": {"dataset": "set/f", "unit": "GHz"},
        "tx": {"dataset": "set/tx", **positions},
        "rx": {"dataset": "set/rx", **positions},
    }


def matlab(path):
    """As `save -v7.3` writes xr(rx, tx, f, frame) with e^{+j…}, f(1, f) in GHz, tx(n, 3) in mm with
    x to the right."""
    pair = np.dtype([("real", "<f4"), ("imag", "<f4")])
    with h5py.File(path, "w") as file:
        stored = np.ascontiguousarray(SAMPLES.conj())  # reversed: [frame, frequency, tx, rx]
        file["xr"] = stored.view(pair)
        file["re"], file["im"] = stored.real, stored.imag
        file["set/f"] = TONES_HZ[:, None] / 1e9
        file["set/tx"], file["set/rx"] = (1e3 * (p * [-1, 1, 1]).T for p in (TX_M, RX_M))
    return path


@pytest.fixture
def folder(tmp_path):
    matlab(tmp_path / "hand.mat")
    return tmp_path


def replaced(folder, **sets):
    """Other data sets in the file."""
    with h5py.File(folder / "hand.mat", "a") as file:
        for name, values in sets.items():
            file.pop(name, None)
            file[name] = values


def described(folder, content):
    (folder / MAPPING).write_text(tomlkit.dumps(content))
    return open_capture(folder).echoes()


def same(capture):
    np.testing.assert_allclose(capture.samples, SAMPLES, rtol=1e-6)  # float32
    np.testing.assert_allclose(capture.frequencies_hz, TONES_HZ, rtol=1e-12)
    assert isinstance(capture.aperture, AntennaArray)
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)
    return True


def test_a_file_of_matlab(folder):
    capture = described(folder, mapping())
    about = open_capture(folder).about
    assert (about.name, about.distance_m) == ("hand", 0.3)
    assert same(capture) and open_capture(folder).echoes(1).samples.shape == (1, 5, 3, 4)


def test_times_of_tones_and_frames(folder):
    replaced(folder, **{"set/t": np.array([[3.0], [3.1]])})
    steps = {"start": 0, "step": 1e-3, "count": 5}
    capture = described(folder, mapping() | {"times_s": steps, "frame_times_s": "set/t"})
    np.testing.assert_allclose(capture.times_s, 1e-3 * np.arange(5))
    np.testing.assert_allclose(capture.frame_times_s, [3.0, 3.1])


def test_pairs_gains_sweeps_and_a_slower_wave(folder):
    """xr(pair, sweep, f, frame), counted from 1 as MATLAB does; a pair was not measured, one gain
    is 0."""
    pairs = RNG.permutation(np.argwhere(np.ones((3, 4), bool)))[:9]
    gains = RNG.standard_normal(9) + 2j
    gains[2] = 0
    of_pairs = SAMPLES[:, :, pairs[:, 0], pairs[:, 1]]
    swept = np.stack([of_pairs + 1j, of_pairs - 1j], axis=2) * gains  # [frame, f, sweep, pair]
    swept[..., 5] = np.nan
    axes = ["pair", "sweep", "frequency", "frame"]
    known = mapping(real="re2", imag="im2", axes=axes, sweeps="mean")
    del known["samples"]["dataset"]
    known |= {"wave_speed_m_s": 2e8, "licence": "CC0"}
    known["pairs"] = {"dataset": "pairs", "reversed": True, "first": 1}
    known["gains"] = {"dataset": "g", "axes": ["pair", "re_im"], "reversed": False}
    parts = {"re2": swept.real, "im2": -swept.imag}  # e^{+j…}
    replaced(folder, **parts, pairs=pairs.T + 1.0, g=np.stack([gains.real, -gains.imag], axis=1))
    capture = described(folder, known)
    there = np.zeros((3, 4), bool)
    there[tuple(np.delete(pairs, [2, 5], axis=0).T)] = True
    np.testing.assert_array_equal(capture.aperture.measured, there)
    # single precision
    np.testing.assert_allclose(capture.samples, np.where(there, SAMPLES, 0), atol=1e-6)
    assert (capture.wave_speed_m_s, capture.licence) == (2e8, "CC0")
    known["samples"]["sweeps"] = "frames"
    assert described(folder, known).samples.shape == (4, 5, 3, 4)


def of(**samples):
    return {"samples": samples}


REFUSED = {
    "all that is missing": (
        of(dataset="xs") | {"gains": {"dataset": "g", "axes": ["rx", "tx"], "reversed": True}},
        r"hand\.mat: has no 'g', 'xs'; the file has im, re, set/f, set/rx, set/tx, xr",
    ),
    "axes": (
        of(axes=["tx", "rx", "frequency", "frame"]),
        r"'xr' has shape \(2, 5, 3, 4\); expected \[frame, frequency 5, rx 4, tx 3\] as stored",
    ),
    "real": (
        of(dataset="re"),
        "'re' has values of type float32; expected complex numbers; name the data sets",
    ),
    "a group": (of(dataset="set"), "'set' is not a data set stored in this file"),
    "turned": ({"rx": {"reversed": False}}, r"'set/rx' has shape \(3, 4\); expected \[n, 3\]"),
    "unit": ({"frequencies": {"unit": "THz"}}, r"'frequencies\.unit' is 'THz'"),
    "no antennas": (of(axes=["frequency"]), "the axes must include"),
    "fewer antennas": (of(axes=["rx", "frequency"]), "tx has 3 antennas; expected one, or 'tx' in"),
    "no pairs": (of(axes=["pair", "frequency"]), r"the table \[pairs\]"),
    "sweeps": (of(axes=["rx", "tx", "sweep", "frequency"]), r"the key sweeps \(= "),
    "gains": ({"gains": {"dataset": "re", "axes": ["pair"], "reversed": True}}, "gains.axes name"),
    "speed": ({"wave_speed_m_s": 1.0}, "is 1 m/s; expected 1/100 to 1 times the speed"),
    "outside": ({"file": "../hand.mat"}, "is outside the folder"),
    "no file": (
        {"file": "foot.mat"},
        r"foot\.mat: expected the HDF5, MATLAB, NumPy or CSV file that mapping.toml names",
    ),
}


@pytest.mark.parametrize(("change", "reason"), REFUSED.values(), ids=REFUSED)
def test_mappings_that_do_not_fit_are_refused(folder, change, reason):
    changed = mapping()
    for name, values in change.items():
        changed[name] = changed.get(name, {}) | values if isinstance(values, dict) else values
    with pytest.raises(HandbenchError, match=reason) as caught:
        described(folder, changed)
    assert "\n" not in str(caught.value)


def virtual(secret):
    layout = h5py.VirtualLayout(SAMPLES.shape, np.complex64)
    layout[:] = h5py.VirtualSource(secret, "xr", SAMPLES.shape)
    return lambda file: file.create_virtual_dataset("xr", layout)


def made(*form, **how):
    return lambda file: file.create_dataset("xr", *form, **how)


def linked(link):
    return lambda file: file.update({"xr": link})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (linked(h5py.ExternalLink("secret.mat", "xr")), "has no 'xr'; the file has"),
        (linked(h5py.SoftLink("/re")), "has no 'xr'; the file has"),
        (virtual("secret.mat"), "is not a data set stored in this file"),
        (
            made((9,), "<f4", external=[("secret.mat", 0, 36)]),
            "is not a data set stored in this file",
        ),
        (
            made((10**6, 5, 3, 10**4), "<c8", chunks=(1, 5, 3, 10**4)),
            "but the file has only 0 bytes",
        ),
        (made((2,), h5py.string_dtype()), "'xr' has values of type object; expected numbers"),
    ],
)
def test_data_sets_that_lie_elsewhere_or_hold_no_numbers_are_refused(
    folder, monkeypatch, make, words
):
    monkeypatch.chdir(folder)
    matlab(folder / "secret.mat")
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        make(file)
    with pytest.raises(HandbenchError, match=words):
        described(folder, mapping())


def test_a_moved_transceiver(folder):
    """Real and imaginary parts along an axis, in the order that the mapping says."""
    known = mapping(axes=["re_im", "frequency", "position"], reversed=False, sign="-")
    del known["tx"], known["rx"]
    known["position"] = {"dataset": "p", "unit": "cm", "reversed": False, "x": "left"}
    places = np.arange(36.0).reshape(12, 3)
    samples = SAMPLES[0].reshape(5, 12)
    replaced(folder, xr=np.stack([samples.real, samples.imag]), p=places)
    capture = described(folder, known)
    np.testing.assert_array_equal(capture.samples, SAMPLES[:1].reshape(1, 5, 12))
    np.testing.assert_allclose(capture.aperture.position_m, places / 100)


def test_several_arrays_in_one_file(folder):
    other = mapping(dataset="xr2")
    second = {name: other[name] for name in ("samples", "tx", "rx")}
    second["tx"]["dataset"] = "set/tx2"
    replaced(folder, xr2=2 * SAMPLES, **{"set/tx2": TX_M.T + 100.0})
    capture = described(folder, mapping() | {"array": [second]})
    assert capture.samples.shape == (2, 5, 6, 8)
    np.testing.assert_allclose(capture.samples[:, :, :3, :4], SAMPLES, rtol=1e-6)
    np.testing.assert_allclose(capture.samples[:, :, 3:, 4:], 2 * SAMPLES.conj(), rtol=1e-6)
    assert capture.aperture.measured.sum() == 24 and not capture.samples[:, :, :3, 4:].any()


def test_a_file_of_matlab_before_7_3_is_read_by_the_same_mapping(folder):
    """As SciPy writes it, which shares nothing with the reader."""
    stored = {"xr": SAMPLES.conj().T, "f": TONES_HZ[None] / 1e9, "text": "abc", "deep": {"xr": 1.0}}
    stored |= {"tx": 1e3 * TX_M * [-1, 1, 1], "rx": 1e3 * RX_M * [-1, 1, 1]}
    known = mapping()
    for table, name in (("frequencies", "f"), ("tx", "tx"), ("rx", "rx")):
        known[table]["dataset"] = name
    for packed in (False, True):
        savemat(folder / "hand.mat", stored, do_compression=packed)
        assert same(described(folder, known))
    known["samples"]["dataset"], known["rx"]["dataset"] = "text", "deep"
    words = r"hand\.mat: has no 'deep', 'text'; the file has xr, f, deep/xr, tx, rx"
    with pytest.raises(HandbenchError, match=words):
        described(folder, known)


def test_what_unpacks_to_more_than_fits_is_refused(folder, monkeypatch):
    monkeypatch.setattr("handbench.support.matlab.ARRAY_BYTES", 2**16)
    savemat(folder / "hand.mat", {"xr": np.zeros(2**14)}, do_compression=True)
    with pytest.raises(HandbenchError, match=r"more than 65536 bytes of values .* with -v7\.3"):
        described(folder, mapping())
