"""Echoes in other programs' files: every way of writing them down gives the same capture, all else
is refused."""

import h5py
import numpy as np
import pytest
import tomlkit
from scipy.io import savemat

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import MAPPING
from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.support.errors import HandbenchError

RNG = np.random.default_rng(4)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (3, 3)), RNG.uniform(-0.1, 0.1, (4, 3))
TONES_HZ = np.linspace(72e9, 82e9, 5)
SAMPLES = (RNG.standard_normal((2, 5, 3, 4, 2)) @ [1, 1j]).astype(np.complex64)
STORED = SAMPLES.conj().T  # MATLAB's xr(rx, tx, frequency, frame), with e^{+j…}
PLACES_MM = {"tx": 1e3 * TX_M * [-1, 1, 1], "rx": 1e3 * RX_M * [-1, 1, 1]}  # x to the right
STEPS = {"steps": {"start": 72, "stop": 82, "count": 5}, "unit": "GHz"}
GRID = {
    "columns": [{"start": -30, "stop": 30, "count": 4}, [-20, 0, 20]],
    "unit": "mm",
    "x": "left",
}
SCANNED = SAMPLES[0].transpose(2, 1, 0)  # [x, y, frequency]


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


def scan(**samples) -> dict:
    """A mapping of a raster scan in s.npy."""
    known = {"dataset": "s.npy", "axes": ["x", "y", "frequency"], "reversed": False, "sign": "-"}
    about = {"version": 1, "capture": {"name": "scan"}, "frequencies": STEPS, "position": GRID}
    return about | {"samples": known | samples}


def matlab(path):
    """As `save -v7.3` writes xr, f(1, f) in GHz, and tx(n, 3) in mm."""
    with h5py.File(path, "w") as file:
        stored = np.ascontiguousarray(STORED.T)
        file["xr"] = stored.view(np.dtype([("real", "<f4"), ("imag", "<f4")]))
        file["re"], file["im"] = stored.real, stored.imag
        file["both"] = np.stack([stored.real, stored.imag])
        file["set/f"] = TONES_HZ[:, None] / 1e9
        for name, places in PLACES_MM.items():
            file[f"set/{name}"] = places.T
    return path


def matlab_7(path):
    """As `save -v7` writes the same."""
    savemat(path, {"xr": STORED, "set": {"f": TONES_HZ / 1e9, **PLACES_MM}}, do_compression=True)


def echoes(folder, content):
    (folder / MAPPING).write_text(tomlkit.dumps(content))
    return open_capture(folder).echoes()


def is_the_array(capture, samples=SAMPLES):
    assert isinstance(capture.aperture, AntennaArray)
    np.testing.assert_allclose(capture.samples, samples, rtol=1e-6)  # float32
    np.testing.assert_allclose(capture.frequencies_hz, TONES_HZ, rtol=1e-12)
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)


@pytest.mark.parametrize(
    "samples",
    [
        {},
        {"dataset": "both", "axes": ["rx", "tx", "frequency", "frame", "re_im"]},
        {"dataset": None, "real": "re", "imag": "im"},
    ],
)
def test_an_array_in_hdf5(tmp_path, samples):
    matlab(tmp_path / "hand.mat")
    known = mapping(**samples)
    known["samples"] = {key: value for key, value in known["samples"].items() if value is not None}
    is_the_array(echoes(tmp_path, known))
    assert open_capture(tmp_path).about.distance_m == 0.3


@pytest.mark.parametrize("frames", [1, 2])
def test_an_array_of_matlab_which_has_no_last_axis_of_length_one(tmp_path, frames):
    stored = STORED[..., 0] if frames == 1 else STORED
    savemat(tmp_path / "hand.mat", {"xr": stored, "set": {"f": TONES_HZ / 1e9, **PLACES_MM}})
    is_the_array(echoes(tmp_path, mapping()), SAMPLES[:frames])


def test_packed_files_of_matlab_and_numpy(tmp_path):
    matlab_7(tmp_path / "hand.mat")
    np.savez_compressed(tmp_path / "s.npz", xr=STORED)
    is_the_array(echoes(tmp_path, mapping()))
    is_the_array(echoes(tmp_path, mapping(dataset="s.npz:xr", reversed=False)))


def test_pairs_in_text_less_a_background_in_a_medium(tmp_path):
    pairs, room = [(1, 2), (2, 3), (3, 1), (1, 4)], RNG.standard_normal((5, 1))
    measured = SAMPLES[0, :, [t - 1 for t, _ in pairs], [r - 1 for _, r in pairs]].T
    np.savetxt(tmp_path / "echo.txt", measured + room)
    np.savetxt(tmp_path / "room.dat", room)
    np.savetxt(tmp_path / "tx.csv", TX_M[:, [0, 2, 1]], delimiter=",", header="x,z,y")
    np.save(tmp_path / "rx.npy", RX_M)
    (tmp_path / "pairs.csv").write_text("tx;rx\n" + "\n".join(f"{t};{r}" for t, r in pairs))
    columns = ["tx.csv:x", "tx.csv:y", "tx.csv[:, 1]"]
    known = scan(dataset="echo.txt", axes=["frequency", "pair"]) | {
        "wave_speed_m_s": 2e8,
        "background": {
            "real": "room.dat",
            "imag": "zero.dat",
            "axes": ["frequency"],
            "reversed": False,
        },
        "tx": {"columns": columns, "unit": "m", "x": "left"},
        "rx": {"dataset": "rx.npy", "reversed": False, "unit": "m", "x": "left"},
        "pairs": {"dataset": "pairs.csv", "reversed": False, "first": 1},
    }
    np.savetxt(tmp_path / "zero.dat", 0 * room)
    del known["position"]
    capture = echoes(tmp_path, known)
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)
    for (t, r), echo in zip(pairs, measured.T, strict=True):
        np.testing.assert_allclose(capture.samples[0, :, t - 1, r - 1], echo, rtol=1e-5)
    assert capture.aperture.measured.sum() == 4 and capture.wave_speed_m_s == 2e8


def is_the_scan(capture, samples):
    assert isinstance(capture.aperture, AntennaPairs)
    places_mm = [(x, y, 0) for y in (-20, 0, 20) for x in (-30, -10, 10, 30)]
    np.testing.assert_allclose(1e3 * capture.aperture.tx_m, places_mm, atol=1e-12)
    np.testing.assert_allclose(capture.samples, samples, rtol=1e-5, atol=1e-6)


def test_a_raster_scan_less_its_mean(tmp_path):
    np.save(tmp_path / "s.npy", SCANNED[None] + np.arange(5))
    capture = echoes(tmp_path, scan(subtract_mean=True))
    expected = SAMPLES[:1].reshape(1, 5, 12)
    is_the_scan(capture, expected - expected.mean(axis=2, keepdims=True))


def test_a_scan_in_text_with_lines_and_columns_of_words(tmp_path):
    """A list of places with complex numbers as MATLAB writes them."""
    lines = ["scan 7", "1,2", "place,x,y,72 GHz,…"]
    for k, (y, x) in enumerate(np.ndindex(3, 4)):
        cells = ",".join(f"{v.real}{v.imag:+}i" for v in SCANNED[x, y].astype(complex))
        lines.append(f"P{k},{20 * x - 30},{20 * y - 20},{cells}")
    (tmp_path / "s.csv").write_text("\n".join(lines) + "\n")
    known = scan(dataset="s.csv[:, 3:]", axes=["position", "frequency"]) | {"skip_lines": 3}
    known["position"] = {"columns": ["s.csv[:, 1]", "s.csv[:, 2]"], "unit": "mm", "x": "left"}
    is_the_scan(echoes(tmp_path, known), SAMPLES[:1].reshape(1, 5, 12))


def of(**samples):
    return {"samples": samples}


def of_tones(dataset):
    return {"frequencies": {"dataset": dataset, "unit": "GHz"}}


REFUSED = {
    "missing": (of(dataset="xs"), r"hand\.mat: has no 'xs'; the file has "),
    "order": (of(axes=["tx", "rx", "frequency", "frame"]), r"expected \[frame, frequency 5, rx 4"),
    "real": (of(dataset="re"), "'re' has values of type float32; expected complex numbers"),
    "a group": (of(dataset="set"), "'set' is missing or is not a data set"),
    "no axis of antennas": (of(axes=["frequency"]), "frequency 5"),
    "a table too many": ({"position": GRID}, "the tables do not fit"),
    "a table too few": (of(axes=["pair", "frequency"]), "the tables do not fit"),
    "twice": (of(axes=["rx", "rx", "frequency", "frame"]), r"expected \[frame, frequency 5, rx 4"),
    "background": (
        {"background": {"dataset": "xr", "axes": ["pair"], "reversed": True}},
        "background.axes",
    ),
    "outside": ({"file": "../hand.mat"}, "outside the folder"),
    "no file": ({"file": "foot.mat"}, r"foot\.mat"),
    "columns": ({"tx": {"dataset": None, "columns": [[1, 2], [1, 2, 3]]}}, "mapping.toml"),
    "link": (of(dataset="outer"), "has no 'outer'|links to other files"),
    "elsewhere": (of(dataset="virtual"), "'virtual'"),
    "too large": (of(dataset="huge"), "'huge'"),
    "words": (of_tones("words.csv"), "words.csv"),
    "uneven": (of_tones("uneven.csv"), "uneven.csv"),
    "no title": (of_tones("f.csv:g"), "f.csv: has no 'g'; the file has f"),
    "index": (of_tones("f.csv[:, 3]"), "f.csv"),
    "no MATLAB": (of_tones("f.mat:f"), "f.mat"),
    "cut MATLAB": (of_tones("cut.mat:xr"), "cut.mat"),
    "not numbers": (of_tones("seven.mat:text"), "'seven.mat:text' has values of type"),
    "no field": (of_tones("seven.mat:set/g"), "seven.mat"),
}


@pytest.mark.parametrize(("change", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, change, reason):
    with h5py.File(matlab(tmp_path / "hand.mat"), "a") as file:
        file["outer"] = h5py.ExternalLink("other.mat", "xr")
        layout = h5py.VirtualLayout(SAMPLES.shape, np.complex64)
        layout[:] = h5py.VirtualSource("other.mat", "xr", SAMPLES.shape)
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("huge", (10**6, 5, 3, 10**4), "<c8", chunks=(1, 5, 3, 10**4))
    for name, text in (
        ("words.csv", "a,b\nc,d\n"),
        ("uneven.csv", "1,2\n3\n"),
        ("f.csv", "f\n1\n2\n"),
        ("f.mat", "1 2 3"),
    ):
        (tmp_path / name).write_text(text)
    savemat(tmp_path / "seven.mat", {"text": "abc", "set": {"f": 1.0}})
    matlab_7(tmp_path / "cut.mat")
    (tmp_path / "cut.mat").write_bytes((tmp_path / "cut.mat").read_bytes()[:400])
    changed = mapping()
    for name, values in change.items():
        changed[name] = changed.get(name, {}) | values if isinstance(values, dict) else values
        if isinstance(values, dict):
            changed[name] = {k: v for k, v in changed[name].items() if v is not None}
    with pytest.raises(HandbenchError, match=reason) as caught:
        echoes(tmp_path, changed)
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)


def test_what_unpacks_to_more_than_fits_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("handbench.bench.datasets.named_arrays.ARRAY_BYTES", 2**16)
    savemat(tmp_path / "hand.mat", {"xr": np.zeros(2**14)}, do_compression=True)
    with pytest.raises(HandbenchError, match=r"more than 65536 bytes"):
        echoes(tmp_path, mapping(dataset="xr") | {"frequencies": STEPS})
