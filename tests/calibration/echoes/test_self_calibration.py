"""Self-calibration finds planted errors of an instrument, and says where echoes do not hold
them."""

import numpy as np
import pytest

from handbench.calibration.echoes.channels import CaptureChannels
from handbench.calibration.echoes.corrections import Corrections
from handbench.calibration.echoes.estimate import self_calibrate
from handbench.calibration.echoes.sentences import sentences
from handbench.cli.main import main
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.support.errors import HandbenchError
from tests.calibration.echoes.planted import instrument, planted, recorded

CHANCE = 2.0  # half-widths of 95 %: an error beyond has a probability of 1e-4


@pytest.mark.parametrize(
    ("kind", "unknown"),
    [
        ("pair", ["range_offset"]),
        ("antenna", ["scan_step"]),
        ("pair", ["range_offset", "scan_step"]),
        pytest.param("rails", ["range_offset", "gains"], marks=pytest.mark.slow),
        pytest.param("array", ["gains"], marks=pytest.mark.slow),
    ],
)
def test_planted_errors_are_found(kind, unknown):
    """Three points at several ranges: every estimate is within its interval."""
    truth = planted(5, kind, unknown, snr_db=10, points=3)
    found = self_calibrate(truth.capture, unknown)
    true = {
        "range_offset_m": truth.offset_m,
        "scan_step_x": truth.steps[0],
        "scan_step_y": truth.steps[1],
        "first_depth_m": truth.points_m[np.abs(truth.echoes).argmax(), 2],
    }
    for name, estimate in found.estimates.items():
        assert estimate.determined, name
        assert abs(estimate.value - true[name]) < CHANCE * estimate.half_width, name
    if "gains" in unknown:
        wrong = np.angle(gain_of(found.corrections, truth.capture) / truth.gains)
        assert np.sqrt((unshifted(wrong, truth.capture) ** 2).mean()) < 4 * found.gain_sigma
    text = " ".join(sentences(found))
    assert "not determined" not in text and "the rest is noise" in text


def gain_of(corrections, capture):
    """The gain of each channel [n] by which the corrections divide."""
    return corrections.gain(CaptureChannels.of(capture.aperture), "test")


def unshifted(phases, capture):
    """Phases [n] without what a shift of the target imitates: what grows in proportion to the
    places of transmitter and receiver."""
    channels = CaptureChannels.of(capture.aperture)
    places_m = np.column_stack([np.ones(len(phases)), channels.tx_m[:, :2], channels.rx_m[:, :2]])
    return phases - places_m @ np.linalg.lstsq(places_m, phases, rcond=None)[0]


@pytest.mark.slow
def test_a_flat_target_determines_nothing():
    """A strip bends the paths as a mirror does, not as points do."""
    tones_hz, aperture, tx_m, rx_m, moves, *_ = instrument("pair")
    strip_m = np.array([(0.0, y, 0.16) for y in np.arange(-0.12, 0.12, 0.004)])
    samples = recorded(tones_hz, tx_m, rx_m, 0 * moves, strip_m, np.ones(len(strip_m)))
    capture = RadarCapture(samples[None].astype(np.complex64), tones_hz, aperture)
    found = self_calibrate(capture, ["range_offset"])
    assert not found.estimates["range_offset_m"].determined
    assert found.corrections == Corrections()
    assert "range offset: not determined" in " ".join(sentences(found))


@pytest.mark.parametrize(
    ("kind", "unknown", "snr_db", "words"),
    [
        ("array", ["scan_step"], 10, "the array does not move"),
        ("array", ["range_offset", "gains"], 10, "gains imitate what shows the offset"),
        ("pair", [], 10, 'list in capture.toml what to estimate, e.g. unknown = \\["range_offset"'),
        ("pair", ["range_offset"], -60, "none stands out from the noise"),
    ],
)
def test_what_cannot_be_estimated_is_refused(kind, unknown, snr_db, words):
    truth = planted(4, kind, ["range_offset"], snr_db=snr_db)
    with pytest.raises(HandbenchError, match=words):
        self_calibrate(truth.capture, unknown)


def test_corrections_undo_offset_steps_and_gains():
    """The true values give the samples and places of an instrument without errors."""
    truth = planted(7, "rails", ["range_offset", "scan_step", "gains"], snr_db=200)
    channels = CaptureChannels.of(truth.capture.aperture)
    [side] = channels.sides
    first = [int(np.flatnonzero(side.of == part)[0]) for part in range(side.count)]
    gains = tuple((g.real, g.imag) for g in truth.gains[first].tolist())
    corrections = Corrections(
        range_offset_m=truth.offset_m, scan_step=tuple(truth.steps.tolist()), gains=(gains,)
    )
    corrected = corrections.applied_to(truth.capture, "test")
    tones_hz, _, tx_m, rx_m, moves, *_ = instrument("rails")
    shift_m = moves * np.append(truth.steps - 1, 0)
    np.testing.assert_allclose(corrected.aperture.tx_m, tx_m + shift_m, atol=1e-12)
    clean = recorded(tones_hz, tx_m, rx_m, shift_m, truth.points_m, truth.echoes)
    # complex64 of the capture and of the result, each 6e-8 of samples up to 5
    np.testing.assert_allclose(corrected.samples[0], clean, atol=1e-6)
    with pytest.raises(HandbenchError, match=r"has \[8\] gains; expected \[1\]"):
        corrections.applied_to(planted(1, "pair").capture, "test")


def test_the_command_writes_corrections_that_readers_apply(tmp_path, capsys):
    truth = planted(5, "pair", ["range_offset"], snr_db=10, points=3)
    folder = tmp_path / "scan"
    folder.mkdir()
    save_capture(folder / "echoes.h5", truth.capture)
    (folder / "capture.toml").write_text('version = 1\nname = "scan"\nunknown = ["range_offset"]\n')
    command = ["calibrate", str(folder), "--from-echoes"]
    assert main(command) == 0
    assert "scan: range offset: " in (printed := capsys.readouterr().err) and "written" in printed
    assert main(command) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0  # from the echoes as recorded, not as corrected
    assert printed.splitlines()[0] in capsys.readouterr().err
    image = ["reconstruct", str(folder), "--method", "2fsk", "-o", str(tmp_path / "depth.npz")]
    tones = "--set f1_hz=8.2e9 --set f2_hz=7.2e9 --set first_depth_m=auto --set x.step_m=0.01"
    assert main([*image, *tones.split(), "--set", "y.step_m=0.01"]) == 0
    assert "corrections.json: applied: range offset" in capsys.readouterr().err
    assert main(["calibrate", str(folder)]) == 2
    assert "-o: is missing" in capsys.readouterr().err
    assert main([*command, "-o", "x.json"]) == 2
    assert "takes one CAPTURE and no other file" in capsys.readouterr().err
