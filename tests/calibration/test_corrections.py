"""Range offset and scan step from the echoes of a point, and the file that holds them."""

import numpy as np
import pytest

import handbench.cli.calibrate
from handbench.calibration.corrections import Corrections, from_echoes
from handbench.cli.main import main
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, channel_ends, qar50
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.echoes_file import save_capture
from handbench.support.errors import HandbenchError

TONES_HZ = np.linspace(72e9, 82e9, 24)
POINT_M = np.array([[0.03, -0.02, 0.31]])


def scan():
    """A pair moved over 12 × 12 stops."""
    along = 0.01 * (np.arange(12) - 5.5)
    stops_m = np.array([(x, y, 0) for y in along for x in along])
    return AntennaPairs(stops_m - [0.01, 0, 0], stops_m + [0.01, 0, 0])


def array():
    """Every fourth antenna of the paper's radar."""
    return thin_antennas(recorded(qar50(), POINT_M), 4).aperture


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
        (array, "range_offset", {"range_offset_m": 0.087}, 5e-4),
        (scan, "range_offset", {"range_offset_m": -0.031}, 5e-4),
        (scan, "scan_step", {"scan_step": 1.06}, 1e-3),
    ],
)
def test_an_error_of_the_instrument_is_found(aperture, unknown, errors, within):
    """Undoing the opposite error plants one, which the echoes of one point then show."""
    true = Corrections(**errors)
    opposite = Corrections(range_offset_m=-true.range_offset_m, scan_step=1 / true.scan_step)
    capture = opposite.applied_to(recorded(aperture(), POINT_M))
    found = from_echoes(capture, [unknown]).model_dump()
    assert found == pytest.approx(true.model_dump(), abs=within)


def test_what_the_echoes_do_not_tell_is_refused():
    strip_m = np.column_stack(np.broadcast_arrays(np.linspace(-0.1, 0.1, 41), 0, 0.3))
    for capture, unknown, words in (
        (recorded(scan(), strip_m), ["range_offset"], "one point explains"),
        (recorded(array(), POINT_M), ["scan_step"], "does not move"),
        (recorded(scan(), POINT_M), ["scan_step", "range_offset"], "expected range_offset or"),
    ):
        with pytest.raises(HandbenchError, match=words):
            from_echoes(capture, unknown)


def test_the_command_writes_corrections_that_readers_apply(tmp_path, capsys, monkeypatch):
    folder = tmp_path / "scan"
    folder.mkdir()
    save_capture(folder / "echoes.h5", recorded(scan(), POINT_M))
    found = Corrections(range_offset_m=0.02, scan_step=1.01)
    monkeypatch.setattr(handbench.cli.calibrate, "from_echoes", lambda *_: found)
    (folder / "capture.toml").write_text('version = 1\nname = "scan"\nunknown = ["range_offset"]\n')
    command = ["calibrate", str(folder), "--from-echoes"]
    assert main(command) == 0
    assert main(command) == 2
    assert "--overwrite" in capsys.readouterr().err
    image = ["reconstruct", str(folder), "--method", "2fsk", "-o", str(tmp_path / "depth.npz")]
    tones = "--set tones_hz=[82e9,72e9] --set x.step_m=0.01 --set y.step_m=0.01"
    assert main([*image, *tones.split()]) == 0
    assert "corrections.json: applied: range_offset_m=0.02" in capsys.readouterr().err
    assert main([*command, "-o", "x.json"]) == 2
    assert "takes one CAPTURE and no other file" in capsys.readouterr().err
