"""Mistakes in data that every reader accepts, and the cure that `handbench inspect` names.

The echoes are sums of exponentials over points of an L-shaped plate, and the mistakes are put into
the files: nothing is shared with the checks."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.validation.capture_warnings import (
    conjugation_warnings,
    method_warnings,
    mirror_warnings,
    step_warnings,
)
from handbench.bench.validation.checks import CHANNELS, MAP, order_of_antennas, warnings_of
from handbench.bench.validation.inspection import inspect
from handbench.cli.main import main
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import mesh, read_surface, write_mesh
from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import save_capture
from tests.radar.simulated_points import exact_capture

TONES_HZ = np.r_[np.linspace(72e9, 82e9, 8), 81.8e9, 79.5e9]
CORNERS_M = np.array([(-30, -40), (20, -40), (20, -20), (-10, -20), (-10, 40), (-30, 40)]) * 1e-3
Z_M = 0.29
ONE = np.eye(3)
CONJUGATE = "conjugate the samples"
Change = Callable[[RadarCapture], RadarCapture]


def depth_m(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return Z_M + 0.1 * x_m + 0.15 * y_m


@pytest.fixture(scope="module")
def right() -> RadarCapture:
    """Of 150 points, evenly spread over an L that leans, before every second antenna."""
    x, y = np.random.default_rng(1).uniform(-0.04, 0.04, (2, 3000))
    inside = (x > -0.03) & (x < 0.02) & ((y < -0.02) | (x < -0.01))
    x, y = x[inside][:150], y[inside][:150]
    array = AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])
    return exact_capture(np.stack([x, y, depth_m(x, y)], axis=1), TONES_HZ, array=array)


def written(folder: Path, capture: RadarCapture) -> Path:
    """A capture's folder, with the plate's surface."""
    folder.mkdir(parents=True)
    save_capture(folder / "echoes.h5", capture)
    (folder / "capture.toml").write_text('version = 1\nname = "plate"\nkind = "other"\n')
    vertices_m = np.column_stack([CORNERS_M, depth_m(*CORNERS_M.T)])
    faces = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)]
    write_mesh(folder / "truth.ply", mesh(vertices_m, np.array(faces)))
    return folder


def placed(change: np.ndarray) -> Change:
    """The antennas elsewhere."""

    def place(capture: RadarCapture) -> RadarCapture:
        legs_m = capture.aperture.tx_m, capture.aperture.rx_m
        return replace(capture, aperture=AntennaArray(*(leg_m @ change for leg_m in legs_m)))

    return place


def placed_apart(capture: RadarCapture) -> RadarCapture:
    """A bit of one coordinate is another one."""
    tx_m = capture.aperture.tx_m.copy()
    tx_m[3, 0] *= 16
    return replace(capture, aperture=AntennaArray(tx_m, capture.aperture.rx_m))


def swapped(capture: RadarCapture) -> RadarCapture:
    array = capture.aperture
    return replace(capture, aperture=AntennaArray(array.rx_m, array.tx_m))


def shuffled(capture: RadarCapture) -> RadarCapture:
    array = capture.aperture
    order = np.random.default_rng(0).permutation(len(array.rx_m))
    return replace(capture, aperture=AntennaArray(array.tx_m, array.rx_m[order]))


def conjugate(capture: RadarCapture) -> RadarCapture:
    return replace(capture, samples=capture.samples.conj())


def tones(tones_hz: np.ndarray) -> Change:
    return lambda capture: replace(capture, frequencies_hz=tones_hz)


def samples(of: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda capture: replace(capture, samples=of(capture.samples).astype(np.complex64))


def cut(echoes: np.ndarray) -> np.ndarray:
    """The last 3 % of a frame were not written."""
    written = np.arange(echoes.size) < 0.97 * echoes.size
    return echoes * written.reshape(echoes.shape)


def turned(capture: RadarCapture) -> RadarCapture:
    """Without the last receiver: else the exchange of Tx and Rx would mend it, too."""
    array = AntennaArray(capture.aperture.tx_m, capture.aperture.rx_m[:-1])
    fewer = replace(capture, samples=capture.samples[..., :-1], aperture=array)
    return placed(ONE[[1, 0, 2]])(fewer)


LOUD = np.where(np.arange(10) == 7, 18.0, 1.0)[:, None, None]
ECHOES = {
    "no imaginary part": (samples(np.real), "imaginary"),
    "no sign": (samples(lambda echoes: np.abs(echoes.real) + 1j * echoes.imag), "signed"),
    "a loud tone": (samples(lambda echoes: echoes * LOUD), "25 dB"),
    "leakage": (samples(lambda echoes: echoes + 500 * np.abs(echoes).max()), '"positions"'),
    "cut": (samples(cut), "3 %"),
    "twice": (samples(lambda echoes: np.concatenate([echoes, echoes])), "1 of 2 frames"),
    "short": (samples(lambda echoes: np.concatenate([echoes, 0 * echoes])), "1 of 2 frames"),
    "conjugated": (conjugate, CONJUGATE),
    "nothing": (lambda capture: capture, None),
    "tones": (tones(TONES_HZ[::-1]), "reverse frequencies_hz"),
    "receivers in disorder": (shuffled, "beside the surface"),
    "swapped": (swapped, "exchange tx_m and rx_m"),
    "x and y": (turned, "exchange these columns"),
    "millimetres": (placed(1e3 * ONE), "1e-3"),
    "centimetres": (placed(1e2 * ONE), "wavelengths"),
    "one antenna": (placed_apart, "-1.128"),
    "kilometres": (placed(1e-3 * ONE), "wavelengths"),
    "y and z": (placed(ONE[[0, 2, 1]]), "faces y"),
    "gigahertz": (tones(TONES_HZ / 1e9), "1e9"),
}


@pytest.mark.parametrize(("change", "cure"), ECHOES.values(), ids=ECHOES)
def test_a_mistake_in_the_echoes_is_named_with_its_cure(right, tmp_path, change, cure):
    lines = inspect(str(written(tmp_path / "plate", change(right)))).lines
    named = [line for line in lines if lines[line]] or [*lines]
    assert len(named) == (cure is not None) and all(cure in line for line in named)


CROSS = AntennaArray(*(np.linspace(-0.07, 0.07, 20)[:, None] * np.eye(3)[axis] for axis in (0, 1)))
BANDS_HZ = {
    "wide": np.linspace(72e9, 82e9, 32),
    "26 GHz": np.linspace(22e9, 26e9, 11),
    "narrow": np.linspace(24e9, 24.12e9, 8),
    "few": np.array([82e9, 81.8e9, 79.5e9]),
}


@pytest.mark.parametrize(
    "tones_hz",
    [
        pytest.param(tones_hz, id=name, marks=[pytest.mark.slow] if name == "wide" else [])
        for name, tones_hz in BANDS_HZ.items()
    ],
)
def test_right_echoes_are_not_accused_whatever_the_band_and_the_place(tones_hz):
    draw = np.random.default_rng(2)
    for number in range(3):
        distance_m = 10 ** draw.uniform(np.log10(0.15), np.log10(0.9))
        points_m = draw.uniform(-0.3, 0.3, (draw.integers(1, 6), 3)) * distance_m
        capture = exact_capture(points_m + [0, 0, distance_m], tones_hz, array=CROSS)
        noise = np.random.default_rng(1).standard_normal((*capture.samples.shape, 2)) @ [1, 1j]
        noise *= 0.1 * (number % 2) * np.abs(capture.samples).max()
        noisy = replace(capture, samples=(capture.samples + noise).astype(np.complex64))
        assert list(conjugation_warnings(noisy)) == []


def test_missing_columns_scans_and_single_tones_have_a_sign(right):
    """The scan is of a transceiver that is moved over a square before a point."""
    point_m, tones_hz = np.array([[-0.03, 0.0, 0.3]]), BANDS_HZ["26 GHz"][::5]
    array = replace(CROSS, measured=np.arange(20)[:, None] % 2 * np.ones(20, int) > 0)
    columns = exact_capture(point_m, BANDS_HZ["few"], array=array)
    columns.samples[:, :, ::2] = 0
    assert "200 of its 400 pairs" in str([*warnings_of(columns, CHANNELS)])
    one = replace(right, samples=right.samples[:, :1], frequencies_hz=TONES_HZ[:1])
    places_m = np.mgrid[-0.05:0.05:10j, -0.05:0.05:10j, 0:1].reshape(3, -1).T
    scan = exact_capture(point_m, tones_hz, array=AntennaPairs(places_m, places_m))
    for capture in (columns, scan, one):
        [text] = conjugation_warnings(conjugate(capture))
        assert list(conjugation_warnings(capture)) == [] and "conjugate" in text


def test_what_is_nearer_than_a_scan_is_wide_has_a_sign():
    points_m = np.array([(0, 0, 0.1), (0.03, 0.02, 0.14), (-0.04, 0.01, 0.2)])
    places_m = np.mgrid[-0.12:0.12:25j, -0.12:0.12:25j, 0:1].reshape(3, -1).T
    scan = AntennaPairs(places_m, places_m)
    capture = exact_capture(points_m, BANDS_HZ["26 GHz"][::2], array=scan)
    [text] = conjugation_warnings(conjugate(capture))
    assert "within 1.3 m" in text  # eight times the middle, at most 14 wavelengths wide
    capture = exact_capture(points_m, BANDS_HZ["few"])  # of an array
    assert [*conjugation_warnings(conjugate(capture))] and not [*conjugation_warnings(capture)]


def test_receivers_of_a_dense_array_in_disorder_are_named_without_a_surface():
    points_m = np.random.default_rng(1).uniform(-0.04, 0.04, (60, 3)) + [0, 0, 0.3]
    capture = exact_capture(points_m, TONES_HZ[-3:])
    assert [*order_of_antennas(capture)] == []
    [text] = order_of_antennas(shuffled(capture))
    assert text.startswith("rx_m")


def test_mirrored_depths_and_linear_amplitudes_are_named(right, tmp_path):
    surface = read_surface(written(tmp_path / "plate", right) / "truth.ply")
    axis_m = np.arange(-50, 51) * 1e-3
    z_m = reference_on_grid(surface, axis_m, axis_m).z_m
    depth = DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), "m")
    assert [*mirror_warnings(depth, surface), *warnings_of(depth, MAP)] == []
    both = z_m[::-1, ::-1]
    for name, mirrored in (("columns", z_m[:, ::-1]), ("rows", z_m[::-1]), ("rows and col", both)):
        [text] = mirror_warnings(replace(depth, z_m=mirrored), surface)
        assert f"its {name}" in text
    [text] = warnings_of(replace(depth, amplitude_db=np.ones_like(z_m)), MAP)
    assert "linear" in text
    [text] = warnings_of(replace(depth, x_m=1e3 * axis_m), MAP)
    assert "millimetres" in text


def test_a_scan_s_wrong_step_is_told_by_the_bend_of_its_point():
    steps_m = np.mgrid[-0.12:0.12:13j, -0.12:0.12:13j, 0:1].reshape(3, -1).T
    scan = AntennaPairs(steps_m, steps_m)
    right = exact_capture((0.02, 0.01, 0.3), BANDS_HZ["26 GHz"], array=scan)
    for factor in (1.0, 0.8):
        capture = replace(right, aperture=AntennaPairs(factor * steps_m, factor * steps_m))
        assert ["1.25" in text for text in step_warnings(capture)] == [True] * (factor < 1)


def test_a_depth_map_that_fills_the_image_or_is_flagged_is_warned_of(tmp_path):
    axis_m, z_m = np.arange(-5, 6) * 1e-2, np.full((11, 11), 0.3)
    full = DepthMap(axis_m, axis_m, z_m, 0 * z_m, "m", p_gross=3 * z_m)
    assert [text[:5] for text in warnings_of(full, MAP)] == ["100 %"] * 2
    part = replace(full, z_m=np.where(np.arange(11) < 3, z_m, np.nan), p_gross=z_m / 3)
    cropped = replace(full, x_m=axis_m / 10, y_m=axis_m / 10, p_gross=z_m / 3)
    assert [*warnings_of(part, MAP), *warnings_of(cropped, MAP)] == []
    replace(part, z_m=np.where(axis_m < 0, z_m, 0)).save(tmp_path / "zeros.npz")
    assert "66 depths" in str(method_warnings([("own", tmp_path / "zeros.npz")]))


def test_a_run_records_its_warnings_and_the_result_shows_them(right, tmp_path, capsys):
    few = replace(right, samples=right.samples[:, -3:], frequencies_hz=TONES_HZ[-3:])
    written(tmp_path / "plate", conjugate(few))
    bench, out = tmp_path / "bench.toml", tmp_path / "out"
    capture = '[[capture]]\npath = "plate"\nmeasures = ["accuracy"]\n'
    bench.write_text(f'version = 1\nname = "b"\n{capture}[[method]]\nid = "2fsk"\n')
    for seen in (True, False):  # a resumed run does not look again
        assert main(["run", str(bench), "-o", str(out)]) == 0
        assert (CONJUGATE in capsys.readouterr().err) == seen
        [warning] = json.loads((out / "result.json").read_text())["facts"]["warnings"]["plate"]
        assert CONJUGATE in warning
    assert [line for line in inspect(str(out)).lines if CONJUGATE in line]
