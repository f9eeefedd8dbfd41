"""Mappings of files as other programs write them: tables of text, NumPy's, structures of MATLAB,
files of one place each; antennas that are moved, backgrounds and probes."""

import itertools

import h5py
import numpy as np
import pytest
import tomlkit
from scipy.io import savemat

from handbench.bench.datasets.dataset import open_capture
from handbench.radar.data.arrays import BistaticScan, PlanarScan
from handbench.support.errors import HandbenchError

RNG = np.random.default_rng(8)
TONES_HZ = np.linspace(2e9, 4e9, 5)
X_MM, Y_MM = np.array([-30.0, -10, 10, 30]), np.array([-20.0, 0, 20])
GRID = RNG.standard_normal((4, 3, 5)) + 1j * RNG.standard_normal((4, 3, 5))  # [x, y, frequency]
PLACES_MM = [(x, y) for y in Y_MM for x in X_MM]  # in the order of a capture


def opened(folder, **tables):
    """The echoes of a mapping with these tables."""
    mapping = {"version": 1, "capture": {"name": "scan"}} | tables
    (folder / "mapping.toml").write_text(tomlkit.dumps(mapping))
    return open_capture(folder).echoes()


def samples(dataset, *axes, reversed=False, sign="-", **more):
    known = {"dataset": dataset, "axes": axes, "reversed": reversed, "sign": sign} | more
    return {key: value for key, value in known.items() if value is not None}


STEPS = {"steps": {"start": 2.0, "stop": 4.0, "count": 5}, "unit": "GHz"}
GRID_COLUMNS = {
    "columns": [{"start": -30, "step": 20, "count": 4}, {"start": -20, "stop": 20, "count": 3}],
    "unit": "mm",
    "x": "left",
}


def is_the_grid(capture):
    expected = np.array([GRID[list(X_MM).index(x), list(Y_MM).index(y)] for x, y in PLACES_MM]).T
    assert isinstance(capture.aperture, PlanarScan)
    np.testing.assert_allclose(capture.samples[0], expected, rtol=1e-6)
    np.testing.assert_allclose(capture.frequencies_hz, TONES_HZ, rtol=1e-12)
    places_m = [(x / 1e3, y / 1e3, 0) for x, y in PLACES_MM]
    np.testing.assert_allclose(capture.aperture.position_m, places_m, atol=1e-15)


def npy(folder):
    np.save(folder / "s.npy", GRID)
    return samples("s.npy", "x", "y", "frequency")


def npz_interleaved(folder):
    parts = np.stack([GRID.T.real, GRID.T.imag], axis=-1)  # [frequency, y, x, re_im]
    np.savez(folder / "s.npz", other=1.0, s=parts.reshape(5, 3, 8))
    return samples("s.npz:s", "frequency", "y", ["x", "re_im"])


def semicolons(folder):
    rows = [
        f"{x};{y};{float(v.real)!r};{float(v.imag)!r}"
        for x, col in zip(X_MM, GRID, strict=True)
        for y, at in zip(Y_MM, col, strict=True)
        for v in at
    ]
    (folder / "s.csv").write_text("measured on Monday\n# x;y;re;im\n" + "\n".join(rows) + "\n")
    axes = [["x", "y", "frequency"]]
    return samples(None, *axes, real="s.csv:re", imag="s.csv[:, 3]")


def complex_text(folder):
    flat = GRID.reshape(12, 5).astype(str)
    matlab = [",".join(v.strip("()").replace("j", "i") for v in row) for row in flat]
    (folder / "s.csv").write_text("\n".join(matlab))
    return samples("s.csv", ["x", "y"], "frequency")


def file_of_each_row(folder):
    for number, row in zip((2, 9, 10, 11), GRID, strict=True):
        savemat(folder / f"row{number}.mat", {"row": {"s": row.T}})
    return samples("row*.mat:row/s", "frequency", "y", "x", reversed=True)


@pytest.mark.parametrize(
    "write", [npy, npz_interleaved, semicolons, complex_text, file_of_each_row]
)
def test_a_raster_scan(tmp_path, write):
    is_the_grid(opened(tmp_path, samples=write(tmp_path), frequencies=STEPS, position=GRID_COLUMNS))


@pytest.mark.parametrize("version", ["7", "7.3"])
def test_a_cell_array_of_matlab(tmp_path, version):
    """A cell, or a structure of an array, of each row; a table of tones in a structure."""
    if version == "7":
        cells = np.empty(4, object)
        cells[:] = [row.T for row in GRID]
        savemat(tmp_path / "s.mat", {"scan": {"s": cells, "set": {"f": TONES_HZ / 1e9}}})
    else:
        pair = np.dtype([("real", "<f8"), ("imag", "<f8")])
        with h5py.File(tmp_path / "s.mat", "w") as file:
            targets = [
                file.create_dataset(f"#refs#/{n}", data=_pairs_of(row, pair))
                for n, row in zip("abcd", GRID, strict=True)
            ]
            file["scan/s"] = np.array([[t.ref] for t in targets], h5py.ref_dtype)
            file["scan/set/f"] = TONES_HZ[:, None] / 1e9
    capture = opened(
        tmp_path,
        file="s.mat",
        samples=samples("scan/s/*", "frequency", "y", "x", reversed=True),
        frequencies={"dataset": "scan/set/f", "unit": "GHz"},
        position=GRID_COLUMNS,
    )
    is_the_grid(capture)


def _pairs_of(row, pair):
    values = np.empty(row.shape, pair)
    values["real"], values["imag"] = row.real, row.imag
    return values


@pytest.mark.parametrize("version", ["7", "7.3"])
def test_a_pair_that_is_moved_together_before_a_probe(tmp_path, version):
    """Coordinates as a table for each axis, y down, in cm; the probe has twice as many tones."""
    x, y = np.meshgrid(X_MM / 10, -Y_MM / 10, indexing="ij")
    probe = np.exp(1j * RNG.uniform(-3, 3, 9)) * 7
    measured = GRID * np.exp(2j * np.angle(probe[::2]))
    content = {"X": x, "Y": y, "s": measured}
    if version == "7":
        savemat(tmp_path / "scan.mat", {"d": content})
    else:
        with h5py.File(tmp_path / "scan.mat", "w") as file:
            for name, values in content.items():
                file[f"d/{name}"] = np.ascontiguousarray(values.T)
    np.savetxt(tmp_path / "probe.csv", np.stack([probe.real, probe.imag], 1), delimiter=",")
    antenna = {"unit": "cm", "x": "left", "y": "down"}
    capture = opened(
        tmp_path,
        file="scan.mat",
        samples=samples("d/s", "position", "position", "frequency", reversed=True),
        frequencies=STEPS,
        position={"columns": ["d/X", "d/Y", 1.0], "reversed": True} | antenna,
        tx={"columns": [6, 1]} | antenna,
        rx={"columns": [-6]} | antenna,
        gains={
            "real": "probe.csv[::2, 0]",
            "imag": "probe.csv[::2, 1]",
            "axes": ["frequency"],
            "reversed": False,
            "phase_only": True,
            "passes": 2,
        },
    )
    assert isinstance(capture.aperture, BistaticScan)
    tx_m, rx_m = capture.aperture.tx_m, capture.aperture.rx_m
    np.testing.assert_allclose(tx_m - rx_m, np.tile([0.12, -0.01, 0], (12, 1)), atol=1e-12)
    assert (rx_m[:, 2] == 0.01).all()
    for (i, x_mm), (k, y_mm) in itertools.product(enumerate(X_MM), enumerate(Y_MM)):
        [at] = np.flatnonzero(np.abs(rx_m[:, :2] - [x_mm / 1e3 - 0.06, y_mm / 1e3]).sum(1) < 1e-9)
        np.testing.assert_allclose(capture.samples[0, :, at], GRID[i, k], rtol=1e-6)


def test_pairs_in_text_less_a_background(tmp_path):
    pairs = [(1, 2), (2, 3), (3, 1), (1, 3)]
    places_m = RNG.uniform(-0.1, 0.1, (3, 3))
    echoes = GRID.reshape(12, 5)[:4].T  # [frequency, pair]
    room = RNG.standard_normal(5)
    np.savetxt(tmp_path / "tumour_1.txt", echoes + room[:, None])
    np.savetxt(tmp_path / "room.dat", room + 0j)
    np.savetxt(tmp_path / "places.csv", places_m[:, [0, 2, 1]], delimiter=",", header="x,depth,y")
    (tmp_path / "pairs.csv").write_text("tx,rx\n" + "\n".join(f"{t},{r}" for t, r in pairs))
    columns = ["places.csv:x", "places.csv:y", "places.csv[:,1]"]
    antennas = {"columns": columns, "unit": "m", "x": "left"}
    capture = opened(
        tmp_path,
        samples=samples("tumour_1.txt", "frequency", "pair"),
        background={"dataset": "room.dat", "axes": ["frequency"], "reversed": False},
        frequencies=STEPS,
        pairs={"dataset": "pairs.csv", "reversed": False, "first": 1},
        tx=antennas,
        rx=antennas,
    )
    np.testing.assert_allclose(capture.aperture.tx_m, places_m, atol=1e-15)
    for (t, r), column in zip(pairs, echoes.T, strict=True):
        np.testing.assert_allclose(capture.samples[0, :, t - 1, r - 1], column, rtol=1e-5)
    assert capture.aperture.measured.sum() == 4


def test_a_small_array_on_rails(tmp_path):
    """Samples [stop, tx·rx, snapshot, frequency]: every path of every channel is in its place."""
    tx_mm, rx_mm, stops_mm, up_mm = (
        [0.0, 40.0],
        [0.0, 5.0, 10.0],
        [0.0, 100.0],
        [0.0, 2.0, 4.0, 6.0],
    )
    value = np.zeros((2, 6, 4, 1))
    for (i, s), (j, t), (k, r), (m, u) in itertools.product(
        *map(enumerate, (stops_mm, tx_mm, rx_mm, up_mm))
    ):
        value[i, 3 * j + k, m] = s + 1e-3 * u + 1e3 * t + 1e5 * r
    np.save(tmp_path / "cube.npy", value + 0j)
    np.save(tmp_path / "g.npy", np.array([1.0, 2.0j]))
    unit = {"unit": "mm", "x": "left"}
    capture = opened(
        tmp_path,
        samples=samples("cube.npy", "x", ["tx", "rx"], "y", "frequency"),
        frequencies={"steps": {"start": 60, "step": 1, "count": 1}, "unit": "GHz"},
        position={"columns": [stops_mm, up_mm]} | unit,
        tx={"columns": [tx_mm]} | unit,
        rx={"columns": [0, rx_mm]} | unit,
        gains={"dataset": "g.npy", "axes": ["tx"], "reversed": False},
    )
    aperture = capture.aperture
    tx, rx = 1e3 * aperture.tx_m, 1e3 * aperture.rx_m
    found = capture.samples[0, 0]
    for t, r in np.ndindex(*found.shape) if found.ndim == 2 else ((n, n) for n in range(len(tx))):
        if found.ndim == 2 and (aperture.measured is None or not aperture.measured[t, r]):
            continue
        stop, up, row = rx[r, 0], tx[t, 1], rx[r, 1] - tx[t, 1]
        sent = tx[t, 0] - stop
        gain = 1 if sent < 1 else 2j
        expected = (stop + 1e-3 * up + 1e3 * sent + 1e5 * row) / gain
        assert found[(t, r) if found.ndim == 2 else t] == pytest.approx(expected, rel=1e-5)


def with_(**change):
    return change


REFUSED = {
    "no file": (with_(samples=samples("s", "x", "y", "frequency")), "'s' names no file; expected"),
    "no such file": (with_(samples=samples("p*.npy", "x", "y", "frequency")), "stands for 0 files"),
    "outside": (with_(samples=samples("../s.npy", "x", "y", "frequency")), "is outside the folder"),
    "not numbers": (
        with_(frequencies={"dataset": "words.csv", "unit": "Hz"}),
        "words.csv: is not a readable CSV file .no line of it holds only numbers",
    ),
    "uneven": (
        with_(frequencies={"dataset": "uneven.csv", "unit": "Hz"}),
        "uneven.csv: is not a readable CSV file",
    ),
    "column": (
        with_(frequencies={"dataset": "f.csv:g", "unit": "Hz"}),
        "f.csv: has no 'g'; the file has f",
    ),
    "index": (with_(frequencies={"dataset": "f.csv[:, 3]", "unit": "Hz"}), "part of shape .5, 1."),
    "word": (
        with_(frequencies={"dataset": "f.csv[1:2:3:4]", "unit": "Hz"}),
        "expected a number or start:stop:step",
    ),
    "step and stop": (
        with_(frequencies={"steps": {"start": 1, "step": 1, "stop": 2, "count": 2}, "unit": "Hz"}),
        "give either step or stop",
    ),
    "steps and dataset": (with_(frequencies={**STEPS, "dataset": "f.csv"}), "give either dataset"),
    "grid": (
        with_(position={"columns": [[0, 1]], "unit": "m", "x": "left"}),
        r"'s.npy' has shape \(4, 3, 5\); expected \[x 2, y 1, frequency 5\]",
    ),
    "position too": (with_(samples=samples("s.npy", "x", "position", "frequency")), "both ways"),
    "one antenna": (with_(tx={"columns": [0], "unit": "m", "x": "left"}), r"\[tx\] and \[rx\]"),
    "background": (
        with_(background={"dataset": "s.npy", "axes": ["tx"], "reversed": False}),
        'background.axes name "tx"',
    ),
    "pickle": (
        with_(samples=samples("o.npy", "x", "y", "frequency")),
        "o.npy: is not a readable NumPy file",
    ),
    "several files": (
        with_(samples=samples("f*.csv", "x", "y", "frequency")),
        "number 2 of 2 has shape",
    ),
    "key": (with_(position={**GRID_COLUMNS, "step": 1}), "unknown key 'position.step'"),
    "column of position": (
        with_(position={**GRID_COLUMNS, "columns": [True, {"count": 2}]}),
        "position.columns",
    ),
}


@pytest.mark.parametrize(("change", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, change, reason):
    np.save(tmp_path / "s.npy", GRID)
    np.save(tmp_path / "o.npy", np.array([None, {}]), allow_pickle=True)
    (tmp_path / "words.csv").write_text("a,b\nc,d\n")
    (tmp_path / "uneven.csv").write_text("1,2\n3\n")
    (tmp_path / "f.csv").write_text("f\n1\n2\n3\n4\n5\n")
    (tmp_path / "f2.csv").write_text("1\n2\n")
    known = {"frequencies": STEPS, "position": GRID_COLUMNS} | {
        "samples": samples("s.npy", "x", "y", "frequency")
    }
    with pytest.raises(HandbenchError, match=reason) as caught:
        opened(tmp_path, **(known | change))
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)
