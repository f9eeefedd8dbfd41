"""Echoes in somebody else's HDF5 file: every way of writing them down gives the same capture, all
else is refused."""

import h5py
import numpy as np
import pytest
import tomlkit
from scipy.io import savemat

from handbench.bench.datasets.dataset import import_capture, open_capture
from handbench.bench.datasets.mapped_capture import MAPPING
from handbench.radar.data.arrays import AntennaArray
from handbench.support.errors import HandbenchError

RNG = np.random.default_rng(4)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (3, 3)), RNG.uniform(-0.1, 0.1, (4, 3))
TONES_HZ = np.linspace(72e9, 82e9, 5)
SAMPLES = (RNG.standard_normal((2, 5, 3, 4)) + 1j * RNG.standard_normal((2, 5, 3, 4))).astype(
    np.complex64
)
ORDER = ("frame", "frequency", "tx", "rx")


def mapping(**samples) -> dict:
    """A mapping of the file that `matlab` writes, with what differs of its samples."""
    positions = {"unit": "mm", "reversed": True, "x": "right"}
    echoes = {
        "dataset": "xr",
        "axes": ["rx", "tx", "frequency", "frame"],
        "reversed": True,
        "sign": "+",
    }
    return {
        "version": 1,
        "file": "hand.mat",
        "capture": {"name": "hand", "distance_m": 0.3},
        "samples": echoes | samples,
        "frequencies": {"dataset": "set/f", "unit": "GHz"},
        "tx": {"dataset": "set/tx", **positions},
        "rx": {"dataset": "set/rx", **positions},
    }


def matlab(path, samples=SAMPLES):
    """As `save -v7.3` writes xr(rx, tx, f, frame) with e^{+j…}, f(1, f) in GHz, tx(n, 3) in mm with
    x to the right."""
    pair = np.dtype([("real", "<f4"), ("imag", "<f4")])
    with h5py.File(path, "w") as file:
        stored = np.ascontiguousarray(samples.conj())  # reversed: [frame, frequency, tx, rx]
        file["xr"] = stored.view(pair)
        file["re"], file["im"] = stored.real, stored.imag
        file["set/f"] = TONES_HZ[:, None] / 1e9
        file["set/tx"], file["set/rx"] = (1e3 * (p * [-1, 1, 1]).T for p in (TX_M, RX_M))
    return path


@pytest.fixture
def folder(tmp_path):
    matlab(tmp_path / "hand.mat")
    (tmp_path / MAPPING).write_text(tomlkit.dumps(mapping()))
    return tmp_path


def described(folder, content):
    (folder / MAPPING).write_text(tomlkit.dumps(content))
    return open_capture(folder).echoes()


def same(capture, samples=SAMPLES):
    np.testing.assert_allclose(capture.samples, samples, rtol=1e-6)  # float32
    np.testing.assert_allclose(capture.frequencies_hz, TONES_HZ, rtol=1e-12)
    assert isinstance(capture.aperture, AntennaArray)
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)
    return True


def test_a_file_of_matlab(folder):
    capture = open_capture(folder)
    assert (capture.about.name, capture.about.distance_m, capture.mesh(), capture.photos) == (
        "hand",
        0.3,
        None,
        None,
    )
    assert same(capture.echoes())
    assert capture.echoes(1).samples.shape == (1, 5, 3, 4)


def test_both_parts_apart(folder):
    told = mapping(real="re", imag="im")
    del told["samples"]["dataset"]
    assert same(described(folder, told))


@pytest.mark.parametrize(
    "order", [ORDER, ("rx", "frame", "tx", "frequency"), ("frequency", "tx", "rx")]
)
@pytest.mark.parametrize("parts", ["complex", "re_im first", "re_im last"])
@pytest.mark.parametrize("turned", [False, True])
def test_any_order_of_axes(folder, order, parts, turned):
    """The file is written in the order that the mapping tells, and reversed as a whole where it
    says so."""
    samples = SAMPLES if "frame" in order else SAMPLES[:1]
    stored = samples if "frame" in order else samples[0]
    stored = stored.transpose([[a for a in ORDER if a in order].index(axis) for axis in order])
    axes = list(order)
    if parts != "complex":
        place = 0 if parts == "re_im first" else -1
        stored = np.stack([stored.real, stored.imag], axis=place)
        axes.insert(0 if place == 0 else len(axes), "re_im")
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file["xr"] = stored.T if turned else stored
    assert same(described(folder, mapping(axes=axes, reversed=turned, sign="-")), samples)


def test_a_moved_transceiver(folder):
    told = mapping(axes=["frequency", "position"], reversed=False, sign="-")
    del told["tx"], told["rx"]
    told["position"] = {"dataset": "p", "unit": "cm", "reversed": False, "x": "left"}
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file["xr"], file["p"] = SAMPLES[0].reshape(5, 12), np.arange(36.0).reshape(12, 3)
    capture = described(folder, told)
    np.testing.assert_array_equal(capture.samples, SAMPLES[:1].reshape(1, 5, 12))
    np.testing.assert_allclose(capture.aperture.position_m, np.arange(36).reshape(12, 3) / 100)


def test_a_file_of_matlab_before_7_3_is_read_by_the_same_mapping(folder):
    """As SciPy writes it, which shares nothing with the reader."""
    stored = {
        "xr": SAMPLES.conj().T,
        "f": TONES_HZ[None] / 1e9,
        "n": 3.0,
        "text": "abc",
        "cell": np.array([[1, "a"]], object),
    }
    stored |= {"tx": 1e3 * TX_M * [-1, 1, 1], "rx": 1e3 * RX_M * [-1, 1, 1], "deep": {"xr": 1.0}}
    told = mapping()
    told["frequencies"]["dataset"], told["tx"]["dataset"], told["rx"]["dataset"] = "f", "tx", "rx"
    for packed in (False, True):
        savemat(folder / "hand.mat", stored, do_compression=packed)
        assert same(described(folder, told))
    told["samples"]["dataset"], told["rx"]["dataset"] = "text", "deep"
    with pytest.raises(
        HandbenchError, match=r"hand\.mat: has no 'deep', 'text' inside; it has xr, f, n, tx, rx"
    ):
        described(folder, told)
    whole = (folder / "hand.mat").read_bytes()
    for length in (130, 200, len(whole) // 2):
        (folder / "hand.mat").write_bytes(whole[:length])
        with pytest.raises(HandbenchError) as caught:
            described(folder, told)
        assert "\n" not in str(caught.value)


def test_what_unpacks_to_more_than_is_read_is_refused(folder, monkeypatch):
    monkeypatch.setattr("handbench.support.matlab.ARRAY_BYTES", 2**16)
    savemat(folder / "hand.mat", {"xr": np.zeros(2**14)}, do_compression=True)
    assert (folder / "hand.mat").stat().st_size < 2**10
    with pytest.raises(HandbenchError, match=r"more than 65536 bytes unpacked, .* save -v7\.3"):
        open_capture(folder).echoes()


def test_pairs_gains_sweeps_and_a_slower_wave(folder):
    """xr(pair, sweep, f, frame), counted from 1 as MATLAB does; a pair was not measured, one gain
    is 0."""
    pairs = RNG.permutation(np.argwhere(np.ones((3, 4), bool)))[:9]
    gains = RNG.standard_normal(9) + 2j
    gains[2] = 0
    of_pairs = SAMPLES[:, :, pairs[:, 0], pairs[:, 1]]
    swept = np.stack([of_pairs + 1j, of_pairs - 1j], axis=2) * gains  # [frame, f, sweep, pair]
    swept[..., 5] = np.nan
    parts = {
        "real": "re2",
        "imag": "im2",
        "axes": ["pair", "sweep", "frequency", "frame"],
        "sweeps": "mean",
    }
    told = mapping(**parts) | {"wave_speed_m_s": 2e8, "licence": "CC0"}
    del told["samples"]["dataset"]
    told["pairs"] = {"dataset": "pairs", "reversed": True, "first": 1}
    told["gains"] = {"dataset": "g", "axes": ["pair", "re_im"], "reversed": False}
    with h5py.File(folder / "hand.mat", "a") as file:
        file["re2"], file["im2"] = swept.real, -swept.imag  # e^{+j…}
        file["pairs"], file["g"] = pairs.T + 1.0, np.stack([gains.real, -gains.imag], axis=1)
    capture = described(folder, told)
    there = np.zeros((3, 4), bool)
    for k in set(range(9)) - {2, 5}:
        there[tuple(pairs[k])] = True
    np.testing.assert_array_equal(capture.aperture.measured, there)
    np.testing.assert_allclose(
        capture.samples, np.where(there, SAMPLES, 0), atol=1e-6
    )  # single precision
    assert (capture.wave_speed_m_s, capture.licence) == (2e8, "CC0")
    told["samples"]["sweeps"] = "frames"
    assert described(folder, told).samples.shape == (4, 5, 3, 4)


def test_several_arrays_in_one_file(folder):
    told = mapping()
    second = {name: dict(told[name]) for name in ("samples", "tx", "rx")}
    second["samples"]["dataset"], second["tx"]["dataset"] = "xr2", "set/tx2"
    told["array"] = [second]
    with h5py.File(folder / "hand.mat", "a") as file:
        file["xr2"], file["set/tx2"] = (
            2 * file["xr"][:].view("c8").conj(),
            file["set/tx"][:] + 100.0,
        )
    capture = described(folder, told)
    assert capture.samples.shape == (2, 5, 6, 8)
    np.testing.assert_allclose(capture.samples[:, :, :3, :4], SAMPLES, rtol=1e-6)
    np.testing.assert_allclose(capture.samples[:, :, 3:, 4:], 2 * SAMPLES.conj(), rtol=1e-6)
    assert capture.aperture.measured.sum() == 24 and not capture.samples[:, :, :3, 4:].any()


def test_all_that_is_missing_is_named_at_once(folder):
    told = mapping(dataset="xs")
    told["tx"]["dataset"], told["gains"] = (
        "set/t",
        {"dataset": "g", "axes": ["rx", "tx"], "reversed": True},
    )
    with pytest.raises(HandbenchError, match=r"has no 'g', 'set/t', 'xs' inside; it has"):
        described(folder, told)
    del told["samples"]["reversed"], told["rx"]["unit"], told["file"]
    with pytest.raises(HandbenchError) as caught:
        described(folder, told)
    for key in ("samples.reversed", "rx.unit", "file"):
        assert f"key '{key}' is missing" in str(caught.value)


def test_it_becomes_a_capture_folder(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("import") / "hand"
    import_capture("mapping", folder, out)
    assert same(open_capture(out).echoes())
    assert open_capture(out).about.contains == ("echoes.h5",)


@pytest.mark.parametrize(
    "change, reason",
    [
        (
            {"samples": {"dataset": "xs"}},
            r"hand\.mat: has no 'xs' inside; it has im, re, set/f, set/rx, set/tx, xr",
        ),
        (
            {"samples": {"axes": ["tx", "rx", "frequency", "frame"]}},
            r"'xr' has shape \(2, 5, 3, 4\); expected \[frame, frequency 5, rx 4, tx 3\] as stored",
        ),
        (
            {"samples": {"axes": ["rx", "tx", "frequency"]}},
            r"'xr' has shape \(2, 5, 3, 4\); expected \[frequency 5, tx 3, rx 4\] as stored",
        ),
        (
            {"samples": {"dataset": "re"}},
            "'re' holds float32; expected complex numbers: name the data sets of both parts",
        ),
        ({"samples": {"dataset": "set"}}, "'set' is no data set of this file"),
        ({"rx": {"reversed": False}}, r"'set/rx' has shape \(3, 4\); expected \[n, 3\] of rx"),
        ({"rx": {"dataset": "xr"}}, "'xr' holds .*; expected real numbers"),
        (
            {"frequencies": {"dataset": "re"}},
            r"'re' has shape \(2, 5, 3, 4\); expected \[frequency\]",
        ),
        ({"frequencies": {"unit": "THz"}}, r"'frequencies\.unit' is 'THz'"),
        ({"samples": {"order": "C"}}, r"unknown key 'samples\.order'"),
        ({"samples": {"axes": ["rx", "frequency"]}}, "axes hold"),
        ({"samples": {"real": "re"}}, "give either dataset"),
        ({"samples": {"axes": ["pair", "frequency"]}}, r"the table \[pairs\]"),
        (
            {"samples": {"axes": ["rx", "tx", "sweep", "frequency"]}},
            r"sweeps = \"mean\" or \"frames\" is there if",
        ),
        (
            {"gains": {"dataset": "re", "axes": ["pair"], "reversed": True}},
            "gains.axes name the antennas as",
        ),
        ({"wave_speed_m_s": 1.0}, "wave_speed_m_s: is 1; expected 1/100 to 1 of vacuum's"),
        (
            {"position": {"dataset": "p", "unit": "m", "reversed": False, "x": "left"}},
            r"the table \[position\]",
        ),
        ({"file": "../hand.mat"}, "leaves the folder"),
        (
            {"file": "foot.mat"},
            r"foot\.mat: expected the HDF5 or MATLAB file that mapping\.toml names, found nothing",
        ),
    ],
)
def test_what_does_not_fit_is_told(folder, change, reason):
    told = mapping()
    for table, values in change.items():
        told[table] = {**told.get(table, {}), **values} if isinstance(values, dict) else values
    with pytest.raises(HandbenchError, match=reason) as caught:
        described(folder, told)
    assert "\n" not in str(caught.value)


def test_files_that_lead_elsewhere_are_refused(folder, tmp_path_factory):
    secret = matlab(tmp_path_factory.mktemp("secret") / "hand.mat")
    for link in (h5py.ExternalLink(str(secret), "xr"), h5py.SoftLink("/re")):
        with h5py.File(folder / "hand.mat", "a") as file:
            del file["xr"]
            file["xr"] = link
        with pytest.raises(HandbenchError, match="has no 'xr' inside the file itself"):
            open_capture(folder).echoes()
    layout = h5py.VirtualLayout(SAMPLES.shape, np.complex64)
    layout[:] = h5py.VirtualSource(str(secret), "xr", SAMPLES.shape)
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file.create_virtual_dataset("xr", layout)
    with pytest.raises(HandbenchError, match="is no data set of this file"):
        open_capture(folder).echoes()
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file.create_dataset(
            "xr", SAMPLES.shape, "<f4", external=[(str(secret), 0, 4 * SAMPLES.size)]
        )
    with pytest.raises(HandbenchError, match="is no data set of this file"):
        open_capture(folder).echoes()


def test_data_sets_too_large_and_objects_are_refused(folder):
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file.create_dataset(
            "xr", (10**6, 5, 3, 10**4), "<c8", chunks=(1, 5, 3, 10**4)
        )  # holds nothing yet
    with pytest.raises(HandbenchError, match="of which the file holds 0"):
        open_capture(folder).echoes()
    with h5py.File(folder / "hand.mat", "a") as file:
        del file["xr"]
        file.create_dataset("xr", (2,), h5py.string_dtype())
    with pytest.raises(HandbenchError, match="'xr' holds object; expected numbers"):
        open_capture(folder).echoes()


def test_a_truncated_file_is_one_line(folder):
    whole = (folder / "hand.mat").read_bytes()
    for length in (0, 100, len(whole) // 2, len(whole) - 1):
        (folder / "hand.mat").write_bytes(whole[:length])
        with pytest.raises(
            HandbenchError, match=r"hand\.mat: is not a readable HDF5 or MATLAB file"
        ) as caught:
            open_capture(folder).echoes()
        assert "\n" not in str(caught.value)
