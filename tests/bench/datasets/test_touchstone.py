"""Touchstone files, written here from the format's definition."""

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.touchstone import import_touchstone
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaPairs
from tests.refusals import refuse

RNG = np.random.default_rng(2)
HEADER = "file,tx_x_m,tx_y_m,tx_z_m,rx_x_m,rx_y_m,rx_z_m\n"
ONE = "# GHz S RI R 50\n1 0.5 -0.25\n2 0.125 1\n"
ROW = "a.s1p,0,0,0,0,0,0\n"


def written(folder, files, rows):
    folder.mkdir(exist_ok=True)
    (folder / "positions.csv").write_text(HEADER + rows)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def test_pairs_are_an_array_of_echoes(tmp_path):
    """S21 of all pairs, in degrees and megahertz: the echo of a path has the phase −2πf·path/c."""
    tx_m, tones_hz, files, rows = RNG.uniform(0, 0.1, (3, 3)), [72e9, 77e9, 82e9], {}, ""
    rx_m = tx_m[:2] + 0.2
    path_m = np.add.outer(*(np.linalg.norm(at - [0, 0, 0.5], axis=1) for at in (tx_m, rx_m)))
    echo = 0.4 * np.exp(-2j * np.pi * np.multiply.outer(tones_hz, path_m) / 299_792_458.0)
    for t, r in np.ndindex(3, 2):
        degrees = np.angle(echo[:, t, r], deg=True)
        lines = [f"{f / 1e6} 9 0 0.4 {a} 9 0 9 0" for f, a in zip(tones_hz, degrees, strict=True)]
        files[f"{t}{r}.s2p"] = "\n".join(["! made by hand", "# MHz S MA R 50", *lines, ""])
        rows += ",".join([f"{t}{r}.s2p", *map(str, (*tx_m[t], *rx_m[r]))]) + "\n"
    source, out = written(tmp_path / "source", files, rows), tmp_path / "out"
    assert main(["import", "touchstone", str(source), "-o", str(out)]) == 0
    capture = hb.load(out).echoes
    order = np.ix_(range(3), *(np.lexsort(at.T[::-1]) for at in (tx_m, rx_m)))  # it sorts antennas
    np.testing.assert_allclose(capture.samples[0], echo[order], rtol=1e-6)  # float32
    np.testing.assert_array_equal(capture.aperture.tx_m, tx_m[order[1].ravel()])


def test_one_port_that_is_moved_is_a_scan(tmp_path):
    rows = "".join(f"{k}.s1p,{k / 100},0,0,{k / 100},0,0\n" for k in range(3))
    files = {f"{k}.s1p": ONE.replace("0.5", f"{k}.5") for k in range(3)}
    import_touchstone(written(tmp_path, files, rows), tmp_path / "scan")
    echoes = hb.load(tmp_path / "scan").echoes
    assert isinstance(echoes.aperture, AntennaPairs)
    assert echoes.aperture.tx_m[:, 0].tolist() == [0, 0.01, 0.02]
    assert echoes.samples[0].tolist() == [[0.5 - 0.25j, 1.5 - 0.25j, 2.5 - 0.25j], [0.125 + 1j] * 3]


def test_another_parameter(tmp_path):
    source = written(
        tmp_path, {"a.s2p": "# Hz S RI R 50\n1e9 1 0 2 0 3 0.5 4 0\n"}, ROW.replace("s1p", "s2p")
    )
    import_touchstone(source, tmp_path / "out", parameter="S12")
    assert hb.load(tmp_path / "out").echoes.samples.item() == 3 + 0.5j


@pytest.mark.parametrize(
    ("files", "rows", "place"),
    [
        ({}, "", "positions.csv"),
        ({}, ROW, "a.s1p"),
        ({"a.s1p": ONE}, "a.s1p,0,0\n", "line 2 has no tx_z_m"),
        ({"a.s1p": ONE}, "a.s1p,0,0,0,0,0,5 mm\n", "'5 mm'"),
        ({"a.s1p": ONE}, ROW + "a.s1p,1,0,0,0,0,0\n", "a.s1p twice"),
        ({}, "../a.s1p,0,0,0,0,0,0\n", "positions.csv"),
        ({"a.s1p": "# THz Q RI\n1 0.5 0\n"}, ROW, "a.s1p"),
        ({"a.s1p": ONE + "3 0.5 inf\n"}, ROW, "a.s1p"),
        ({"a.s1p": ONE, "b.s1p": ONE + "3 1 1\n"}, ROW + "b.s1p,1,0,0,0,0,0\n", "b.s1p"),
    ],
)
def test_broken_files_are_refused(tmp_path, files, rows, place):
    source = written(tmp_path, files, rows)
    refuse(lambda: import_touchstone(source, tmp_path / "out"), place)
    (source / "positions.csv").write_text(HEADER.replace("rx_z_m", "z"))
    refuse(lambda: import_touchstone(source, tmp_path / "out"), "no column rx_z_m")
    assert not (tmp_path / "out").exists()
