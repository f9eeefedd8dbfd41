"""Range offset and scan step from the echoes of a point, and the file that holds them."""

import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.calibration.corrections import Corrections, from_echoes
from handbench.cli.main import main
from handbench.radar.data.arrays import (
    SPEED_OF_LIGHT_M_S,
    AntennaArray,
    AntennaPairs,
    channel_ends,
    qar50,
)
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.config import parse
from handbench.support.files import read_json
from tests.refusals import refuse, refuse_command

TONES_HZ = np.linspace(72e9, 82e9, 24)
POINT_M = np.array([[0.03, -0.02, 0.31]])
ALONG_M = 0.01 * (np.arange(12) - 5.5)
STOPS_M = np.array([(x, y, 0) for y in ALONG_M for x in ALONG_M])
SCAN = AntennaPairs(STOPS_M - [0.01, 0, 0], STOPS_M + [0.01, 0, 0])
ARRAY = AntennaArray(qar50().tx_m[::4], qar50().rx_m[::4])  # of the paper


def recorded(aperture, points_m, snr_db=10):
    """Echoes of points with noise: Σ exp(−j2πf·path/c)."""
    draw = np.random.default_rng(3)
    paths_m = [
        sum(np.linalg.norm(end_m - point_m, axis=1) for end_m in channel_ends(aperture))
        for point_m in points_m
    ]
    waves = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_S * np.multiply.outer(TONES_HZ, paths_m))
    samples = waves.sum(axis=1)
    noise = draw.normal(size=samples.shape) + 1j * draw.normal(size=samples.shape)
    samples += noise * np.sqrt((np.abs(samples) ** 2).mean() / 2) * 10 ** (-snr_db / 20)
    shape = 1, len(TONES_HZ), *aperture.channels
    return RadarCapture(samples.reshape(shape).astype(np.complex64), TONES_HZ, aperture)


@pytest.mark.parametrize(
    ("aperture", "unknown", "errors", "within"),
    [
        (ARRAY, "range_offset", {"range_offset_m": 0.087}, 5e-4),
        (SCAN, "range_offset", {"range_offset_m": -0.031}, 5e-4),
        (SCAN, "scan_step", {"scan_step": 1.06}, 1e-3),
    ],
)
def test_an_error_of_the_instrument_is_found(aperture, unknown, errors, within):
    """Undoing the opposite error plants one, which the echoes of one point then show."""
    true = Corrections(**errors)
    opposite = Corrections(range_offset_m=-true.range_offset_m, scan_step=1 / true.scan_step)
    capture = opposite.applied_to(recorded(aperture, POINT_M))
    capture.samples[:, 5] *= 18  # a tone that is 25 dB too strong counts no more than the others
    found = from_echoes(capture, [unknown]).model_dump()
    assert found == pytest.approx(true.model_dump(), abs=within)


def test_what_the_echoes_do_not_tell_is_refused():
    strip_m = np.column_stack(np.broadcast_arrays(np.linspace(-0.1, 0.1, 41), 0, 0.3))
    for capture, unknown, place in (
        (recorded(SCAN, strip_m), ["range_offset"], "echoes"),
        (recorded(ARRAY, POINT_M), ["scan_step"], "scan_step"),
        (recorded(SCAN, POINT_M), ["scan_step", "range_offset"], "unknown"),
    ):
        refuse(lambda capture=capture, unknown=unknown: from_echoes(capture, unknown), place)


def test_the_command_writes_corrections_that_readers_apply(tmp_path, capsys):
    """To single precision of the samples."""
    capture = recorded(SCAN, POINT_M)
    save_capture(tmp_path / "echoes.h5", capture)
    (tmp_path / "capture.toml").write_text('version = 1\nname = "a"\nunknown = ["range_offset"]\n')
    command = ["calibrate", str(tmp_path), "--from-echoes"]
    assert main(command) == 0
    refuse_command(command, "--overwrite")
    refuse_command([*command, "-o", "x.json"], "-o")
    found = parse(Corrections, read_json(tmp_path / "corrections.json", ""), "")
    assert found == from_echoes(capture, ["range_offset"])
    applied = open_capture(tmp_path).echoes(1).samples
    np.testing.assert_allclose(applied, found.applied_to(capture).samples, atol=1e-6)
