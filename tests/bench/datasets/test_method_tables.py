"""Imported captures are imaged at once, by the settings that the import writes."""

import json

import numpy as np
import pytest

from handbench.bench.datasets.method_tables import method_tables
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import load_depthmap
from tests.bench.datasets.ti_captures import stream
from tests.radar.simulated_points import strongest_z_m

C = 299_792_458.0


def paths_m(tx_m, rx_m, point_m):
    return np.linalg.norm(tx_m - point_m, axis=1)[:, None] + np.linalg.norm(rx_m - point_m, axis=1)


def ti_folder(folder, depth_m):
    """A board's antennas, around their middle, and a point before them."""
    tx_m = 2.5e-3 * np.array([[-1.75, -0.5 + 1 / 6, 0], [2.25, -0.5 + 1 / 6, 0]])
    rx_m = 2.5e-3 * np.array([[k - 1.75, 1 / 3, 0] for k in range(4)])
    f = 60e9 + 60e12 * (6e-6 + np.arange(128) / 2.2e6)
    turns = np.exp(2j * np.pi * f * paths_m(tx_m, rx_m, [0.01, 0, depth_m])[..., None] / C)
    noise = np.random.default_rng(0).standard_normal((1, 8, *turns.shape, 2)) @ [50, 50j]
    (folder / "adc_data.bin").write_bytes(stream(np.rint(5000 * turns + noise), range(4)))
    profile = {"start_hz": 60e9, "slope_hz_s": 60e12, "adc_start_s": 6e-6, "rate_hz": 2.2e6}
    profile |= {"samples": 128, "receivers": [1, 2, 3, 4], "transmitters": [1, 3], "loops": 8}
    (folder / "p.json").write_text(json.dumps(profile | {"board": "IWR6843ISK"}))


def touchstone_folder(folder, depth_m):
    """Pairs of a column of transmitters and a row of receivers."""
    tx_m = np.array([[0.0, y, 0.0] for y in np.linspace(-0.03, 0.03, 5)])
    rx_m = np.array([[x, 0.0, 0.0] for x in np.linspace(-0.03, 0.03, 5)])
    f, path_m = np.linspace(72e9, 82e9, 51), paths_m(tx_m, rx_m, [0.01, 0, depth_m])
    rows = ["file,tx_x_m,tx_y_m,tx_z_m,rx_x_m,rx_y_m,rx_z_m"]
    for t, r in np.ndindex(5, 5):
        rows.append(",".join([f"{t}{r}.s2p", *map(str, (*tx_m[t], *rx_m[r]))]))
        values = np.exp(-2j * np.pi * f * path_m[t, r] / C)
        lines = [f"{hz} 0 0 {v.real} {v.imag} 0 0 0 0" for hz, v in zip(f, values, strict=True)]
        (folder / f"{t}{r}.s2p").write_text("# Hz S RI R 50\n" + "\n".join(lines) + "\n")
    (folder / "positions.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.parametrize("method", ["2fsk", "3fsk", "broadband"])
@pytest.mark.parametrize(
    ("kind", "write", "depth_m"),
    [
        ("ti-raw", ti_folder, 0.31),
        ("ti-raw", ti_folder, 1.4),
        ("touchstone", touchstone_folder, 0.5),
    ],
)
def test_an_imported_capture_is_imaged(tmp_path, kind, write, depth_m, method):
    source, capture = tmp_path / "source", tmp_path / "capture"
    source.mkdir()
    write(source, depth_m)
    assert main(["import", kind, str(source), "-o", str(capture)]) == 0
    out = tmp_path / "depth.npz"
    assert main(["reconstruct", str(capture), "--method", method, "-o", str(out)]) == 0
    step_m = {"2fsk": 2e-3, "3fsk": 1e-3, "broadband": 4e-3}[method]  # half of its voxels
    assert strongest_z_m(load_depthmap(out)) == pytest.approx(depth_m, abs=step_m)


@pytest.mark.parametrize(
    ("tones_ghz", "methods"),
    [
        ([72.0], []),
        ([72.0, 72.2], ["2fsk", "broadband"]),
        ([72.0, 80.0, 82.0], ["2fsk", "3fsk"]),
        ([72.0, 77.0, 82.0], ["2fsk", "3fsk", "broadband"]),
    ],
)
def test_few_tones(tones_ghz, methods):
    places_m = np.random.default_rng(0).uniform(-0.05, 0.05, (4, 3)) * [1, 1, 0]
    samples = np.ones((1, len(tones_ghz), 4, 4), np.complex64)
    f = np.array(tones_ghz) * 1e9
    tables = method_tables(RadarCapture(samples, f, AntennaArray(places_m, places_m)))
    assert sorted(tables) == methods
    assert all(not {"x", "y", "z"} & table.keys() for table in tables.values())
