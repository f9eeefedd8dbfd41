"""Touchstone files, written here from the format's definition."""

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.touchstone import import_touchstone
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, AntennaPairs
from handbench.radar.data.depthmap import load_depthmap
from tests.radar.simulated_points import strongest_z_m
from tests.refusals import refuse

HEADER = "file,tx_x_m,tx_y_m,tx_z_m,rx_x_m,rx_y_m,rx_z_m\n"
ONE = "# GHz S RI R 50\n1 0.5 -0.25\n2 0.125 1\n"
ROW = "a.s1p,0,0,0,0,0,0\n"


def written(folder, files, rows):
    folder.mkdir(exist_ok=True)
    (folder / "positions.csv").write_text(HEADER + rows)
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def pairs_of(folder, tx_m, rx_m, point_m):
    """A folder with the echo of a point as S21 of all pairs, in degrees and megahertz."""
    tones_hz, files, rows = np.linspace(72e9, 82e9, 51), {}, ""
    for t, r in np.ndindex(len(tx_m), len(rx_m)):
        path_m = np.linalg.norm(tx_m[t] - point_m) + np.linalg.norm(rx_m[r] - point_m)
        degrees = -360 * tones_hz * path_m / 299_792_458.0
        lines = [
            f"{f / 1e6} 9 0 0.4 {a} 9 0 9 0" for f, a in zip(tones_hz, degrees % 360, strict=True)
        ]
        files[f"{t}{r}.s2p"] = "! made by hand\n# MHz S MA R 50\n" + "\n".join(lines) + "\n"
        rows += ",".join([f"{t}{r}.s2p", *map(str, (*tx_m[t], *rx_m[r]))]) + "\n"
    return written(folder, files, rows)


def test_pairs_are_an_array_whose_images_show_the_target(tmp_path):
    tx_m = np.array([[0.0, y, 0.0] for y in np.linspace(-0.03, 0.03, 5)])
    source = pairs_of(tmp_path / "source", tx_m, tx_m[:, [1, 0, 2]], np.array([0.01, 0, 0.5]))
    out, depth = tmp_path / "out", tmp_path / "depth.npz"
    assert main(["import", "touchstone", str(source), "-o", str(out)]) == 0
    assert isinstance(hb.load(out).echoes.aperture, AntennaArray)
    assert main(["reconstruct", str(out), "--method", "3fsk", "-o", str(depth)]) == 0
    assert strongest_z_m(load_depthmap(depth)) == pytest.approx(0.5, abs=1e-3)


def test_one_port_that_is_moved_is_a_scan(tmp_path):
    rows = "".join(f"{k}.s1p,{k / 100},0,0,{k / 100},0,0\n" for k in range(3))
    files = {f"{k}.s1p": ONE.replace("0.5", f"{k}.5") for k in range(3)}
    import_touchstone(written(tmp_path, files, rows), tmp_path / "scan")
    echoes = hb.load(tmp_path / "scan").echoes
    assert isinstance(echoes.aperture, AntennaPairs)
    assert echoes.aperture.tx_m[:, 0].tolist() == [0, 0.01, 0.02]
    assert echoes.samples[0].tolist() == [[0.5 - 0.25j, 1.5 - 0.25j, 2.5 - 0.25j], [0.125 + 1j] * 3]


def test_another_parameter_of_a_few_of_many_pairs(tmp_path):
    rows = "".join(f"{k}.s2p,{k / 100},1,0,{k / 100},0,0\n" for k in range(12))
    files = {f"{k}.s2p": "# Hz S RI R 50\n1e9 1 0 2 0 3 0.5 4 0\n" for k in range(12)}
    import_touchstone(written(tmp_path, files, rows), tmp_path / "out", parameter="S12")
    echoes = hb.load(tmp_path / "out").echoes
    assert isinstance(echoes.aperture, AntennaPairs)  # twelve pairs of 144
    np.testing.assert_array_equal(echoes.samples, np.full((1, 1, 12), 3 + 0.5j))


@pytest.mark.parametrize(
    ("files", "rows", "place"),
    [
        ({}, "", "positions.csv"),
        ({}, ROW, "a.s1p"),
        ({"a.s1p": ONE}, "a.s1p,0,0\n", "tx_m"),
        ({"a.s1p": ONE}, "a.s1p,0,0,0,0,0,x\n", "positions.csv"),
        ({}, "../a.s1p,0,0,0,0,0,0\n", "positions.csv"),
        ({"a.s1p": "# THz Q RI\n1 0.5 0\n"}, ROW, "a.s1p"),
        ({"a.s1p": ONE + "3 0.5 inf\n"}, ROW, "a.s1p"),
        ({"a.s1p": "!" + "x" * 2**23}, ROW, "a.s1p"),
        ({"a.s1p": ONE, "b.s1p": ONE + "3 1 1\n"}, ROW + "b.s1p,1,0,0,0,0,0\n", "b.s1p"),
    ],
)
def test_broken_files_are_refused(tmp_path, files, rows, place):
    source = written(tmp_path, files, rows)
    refuse(lambda: import_touchstone(source, tmp_path / "out"), place)
    assert not (tmp_path / "out").exists()
