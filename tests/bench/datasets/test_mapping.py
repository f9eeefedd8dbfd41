"""Echoes in other programs' files: every way of writing them down gives the same capture, all else
is refused."""

import h5py
import numpy as np
import pytest
import tomlkit
from scipy.io import savemat

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import MAPPING
from tests.refusals import refuse

RNG = np.random.default_rng(4)
TX_M, RX_M = RNG.uniform(-0.1, 0.1, (3, 3)), RNG.uniform(-0.1, 0.1, (4, 3))
TONES_HZ = np.linspace(72e9, 82e9, 5)
SAMPLES = (RNG.standard_normal((2, 5, 3, 4, 2)) @ [1, 1j]).astype(np.complex64)
STORED = SAMPLES.conj().T  # MATLAB's xr(rx, tx, frequency, frame), with e^{+j…}
SET = {"f": TONES_HZ[None] / 1e9, "tx": 1e3 * TX_M * [-1, 1, 1], "rx": 1e3 * RX_M * [-1, 1, 1]}
AXES = ["rx", "tx", "frequency", "frame"]
PLACES = {"unit": "mm", "reversed": True, "x": "right"}
ARRAY = {
    "version": 1,
    "file": "hand.mat",
    "capture": {"name": "hand", "distance_m": 0.3},
    "samples": {"dataset": "xr", "axes": AXES, "reversed": True, "sign": "+"},
    "frequencies": {"dataset": "set/f", "unit": "GHz"},
    "tx": {"dataset": "set/tx", **PLACES},
    "rx": {"dataset": "set/rx", **PLACES},
}
STEPS = {"start": 72, "stop": 82, "count": 5}
GRID = {"columns": [{"start": -30, "stop": 30, "count": 4}, [-20, 0, 20]], "unit": "mm"}
SCAN = {
    "version": 1,
    "capture": {"name": "scan"},
    "samples": {
        "dataset": "s.npy",
        "axes": ["x", "y", "frequency"],
        "reversed": False,
        "sign": "-",
    },
    "frequencies": {"steps": STEPS, "unit": "GHz"},
    "position": GRID | {"x": "left"},
}
SCANNED = SAMPLES[0].transpose(2, 1, 0)  # [x, y, frequency]


def changed(mapping: dict, **changes) -> dict:
    """A mapping with other keys in its tables; None takes a key away."""
    for name, change in changes.items():
        table = mapping.get(name, {}) | change if isinstance(change, dict) else change
        if isinstance(table, dict):
            table = {key: value for key, value in table.items() if value is not None}
        mapping = mapping | {name: table}
    return {name: table for name, table in mapping.items() if table is not None}


def write_hdf5(path):
    """As `save -v7.3` writes xr, f(1, f) in GHz, and tx(n, 3) in mm."""
    stored = np.ascontiguousarray(STORED.T)
    with h5py.File(path, "w") as file:
        file["xr"] = stored.view(np.dtype([("real", "<f4"), ("imag", "<f4")]))
        file["re"], file["im"] = stored.real, stored.imag
        file["both"] = np.stack([stored.real, stored.imag])
        for name, values in SET.items():
            file[f"set/{name}"] = values.T


def echoes(folder, mapping):
    (folder / MAPPING).write_text(tomlkit.dumps(mapping))
    return open_capture(folder).echoes()


def is_the_array(capture, frames=2):
    np.testing.assert_allclose(capture.samples, SAMPLES[:frames], rtol=1e-6)  # float32
    np.testing.assert_allclose(capture.frequencies_hz, TONES_HZ, rtol=1e-12)
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)


@pytest.mark.parametrize(
    "samples",
    [
        {},
        {"dataset": "both", "axes": [*AXES, "re_im"]},
        {"dataset": None, "real": "re", "imag": "im"},
    ],
)
def test_an_array_in_hdf5(tmp_path, samples):
    write_hdf5(tmp_path / "hand.mat")
    is_the_array(echoes(tmp_path, changed(ARRAY, samples=samples)))
    assert open_capture(tmp_path).about.distance_m == 0.3


@pytest.mark.parametrize("frames", [1, 2])
def test_an_array_of_matlab_which_has_no_last_axis_of_length_one(tmp_path, frames):
    content = {"xr": STORED[..., 0] if frames == 1 else STORED, "set": SET}
    savemat(tmp_path / "hand.mat", content, do_compression=frames == 1)
    is_the_array(echoes(tmp_path, ARRAY), frames)


def test_pairs_in_text_less_a_background_in_a_medium(tmp_path):
    pairs, room = [(1, 2), (2, 3), (3, 1), (1, 4)], RNG.standard_normal((5, 1))
    measured = SAMPLES[0, :, [t - 1 for t, _ in pairs], [r - 1 for _, r in pairs]].T
    np.savetxt(tmp_path / "echo.txt", measured + room)
    np.savez_compressed(tmp_path / "room.npz", re=room, im=0 * room)
    np.savetxt(tmp_path / "tx.csv", TX_M[:, [0, 2, 1]], delimiter=",", header="x,z,y")
    np.save(tmp_path / "rx.npy", RX_M)
    (tmp_path / "pairs.csv").write_text("tx;rx\n" + "\n".join(f"{t};{r}" for t, r in pairs))
    stored = {"reversed": False}
    capture = echoes(
        tmp_path,
        changed(
            SCAN,
            position=None,
            samples={"dataset": "echo.txt", "axes": ["frequency", "pair"]},
            wave_speed_m_s=2e8,
            background={"real": "re", "imag": "im", "axes": ["frequency"], **stored},
            file="room.npz",
            tx={"columns": ["tx.csv:x", "tx.csv:y", "tx.csv[:, 1]"], "unit": "m", "x": "left"},
            rx={"dataset": "rx.npy", "unit": "m", "x": "left", **stored},
            pairs={"dataset": "pairs.csv", "first": 1, **stored},
        ),
    )
    np.testing.assert_allclose(capture.aperture.tx_m, TX_M, atol=1e-15)
    np.testing.assert_allclose(capture.aperture.rx_m, RX_M, atol=1e-15)
    for (t, r), echo in zip(pairs, measured.T, strict=True):
        np.testing.assert_allclose(capture.samples[0, :, t - 1, r - 1], echo, rtol=1e-5)
    assert capture.aperture.measured.sum() == 4 and capture.wave_speed_m_s == 2e8


def is_the_scan(capture, samples):
    places_mm = [(x, y, 0) for y in (-20, 0, 20) for x in (-30, -10, 10, 30)]
    np.testing.assert_allclose(1e3 * capture.aperture.tx_m, places_mm, atol=1e-12)
    np.testing.assert_allclose(capture.samples, samples, rtol=1e-5, atol=1e-6)


def test_a_raster_scan_less_its_mean(tmp_path):
    np.save(tmp_path / "s.npy", SCANNED[None] + np.arange(5))
    samples = SAMPLES[:1].reshape(1, 5, 12)
    capture = echoes(tmp_path, changed(SCAN, background={"mean": "positions"}))
    is_the_scan(capture, samples - samples.mean(axis=2, keepdims=True))


def test_a_scan_in_text_with_lines_and_columns_of_words(tmp_path):
    """A list of places with complex numbers as MATLAB writes them."""
    lines = ["scan 7", "1,2", "place,x,y,72 GHz,…"]
    for k, (y, x) in enumerate(np.ndindex(3, 4)):
        cells = ",".join(f"{v.real}{v.imag:+}i" for v in SCANNED[x, y].astype(complex))
        lines.append(f"P{k},{20 * x - 30},{20 * y - 20},{cells}")
    (tmp_path / "s.csv").write_text("\n".join(lines) + "\n")
    samples = {"dataset": "s.csv[:, 3:]", "axes": ["position", "frequency"]}
    position = {"columns": ["s.csv[:, 1]", "s.csv[:, 2]"]}
    mapping = changed(SCAN, samples=samples, position=position, skip_lines=3)
    is_the_scan(echoes(tmp_path, mapping), SAMPLES[:1].reshape(1, 5, 12))


@pytest.mark.parametrize(
    ("table", "change", "place"),
    [
        ("samples", {"dataset": "xs"}, "'xs'"),
        ("samples", {"axes": ["tx", "rx", "frequency", "frame"]}, "'xr'"),
        ("samples", {"dataset": "re"}, "'re'"),
        ("samples", {"axes": ["pair", "frequency"]}, "[pairs]"),
        ("background", {"dataset": "xr", "axes": ["pair"], "reversed": True}, "background.axes"),
        ("tx", {"dataset": None, "columns": [[1, 2], [1, 2, 3]]}, MAPPING),
        ("frequencies", {"dataset": "../f.csv"}, "../f.csv"),
        ("frequencies", {"dataset": "f.csv:g"}, "'g'"),
        ("frequencies", {"dataset": "text.mat:f"}, ".txt"),
        ("frequencies", {"dataset": "units.csv"}, "'5GHz'"),
        ("frequencies", {"dataset": "two.npy"}, "two.npy"),
        ("frequencies", {"dataset": "7.mat:text"}, "'7.mat:text'"),
        ("frequencies", {"dataset": "cut.mat:text"}, "cut.mat"),
        ("frequencies", {"dataset": "large.mat:xr"}, "65536"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, monkeypatch, table, change, place):
    monkeypatch.setattr("handbench.bench.datasets.named_arrays.ARRAY_BYTES", 2**16)
    write_hdf5(tmp_path / "hand.mat")
    savemat(tmp_path / "7.mat", {"text": "abc"})
    savemat(tmp_path / "large.mat", {"xr": np.zeros(2**14)}, do_compression=True)
    (tmp_path / "cut.mat").write_bytes((tmp_path / "7.mat").read_bytes()[:150])
    (tmp_path / "f.csv").write_text("f\n1\n2\n")
    (tmp_path / "units.csv").write_text("f\n1\n5GHz\n")
    (tmp_path / "text.mat").write_text("1")
    with (tmp_path / "two.npy").open("wb") as file:
        np.save(file, [1.0]), np.save(file, [2.0])
    refuse(lambda: echoes(tmp_path, changed(ARRAY, **{table: change})), str(tmp_path), place)
