"""Advice that foreign captures meet: messages name settings, and with these typed the method images
the capture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.echoes_file import save_capture
from tests.cli.conftest import PIXELS
from tests.radar.simulated_points import exact_capture

SMALL = [*PIXELS, "--set=x.step_m=0.005"]


def foreign(folder, tones_hz, times_s=None):
    """The capture folder of a point before a cross of antennas; the start of a command that images
    it."""
    along, zero = np.linspace(-0.05, 0.05, 12), np.zeros(12)
    array = AntennaArray(np.stack([along, zero, zero], 1), np.stack([zero, along, zero], 1))
    capture = exact_capture((0.0, 0.0, 0.3), tones_hz, array=array)
    capture = replace(capture, times_s=times_s)
    (folder / "foreign").mkdir()
    save_capture(folder / "foreign" / "echoes.h5", capture)
    (folder / "foreign" / "capture.toml").write_text('version = 1\nname = "foreign"\n')
    return ["reconstruct", str(folder / "foreign"), "-o", str(folder / "depth.npz"), *SMALL]


@pytest.mark.parametrize("id", ["3fsk", "3fsk-doppler", "nfsk", "broadband"])
def test_the_settings_that_are_named_image_the_capture(id, tmp_path, capsys):
    tones_hz = np.linspace(76e9, 81e9, 26)[::-1]
    if "doppler" in id:
        again = np.append(tones_hz, tones_hz[0])
        command = foreign(tmp_path, again, times_s=1e-3 * np.arange(len(again)))
    else:
        command = foreign(tmp_path, tones_hz)
    command += ["--method", id]
    assert main(command) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    advice = re.findall(r"\w+=(?:\[.*\]|[^,\s]+)", error.rpartition("e.g. ")[2])
    assert main([*command, *(f"--set={setting}" for setting in advice)]) == 0, advice
    with np.load(tmp_path / "depth.npz") as depth:
        assert np.isfinite(depth["z_m"]).any()


def test_limits_of_the_box_are_reported(tmp_path, capsys):
    tones = "--method broadband --set start_hz=76e9 --set stop_hz=76.3e9 --set count=4"
    command = [*foreign(tmp_path, np.linspace(76e9, 76.3e9, 4)), *tones.split()]
    assert main([*command, "--set=z.start_m=0.1", "--set=z.stop_m=0.2"]) == 0
    printed = capsys.readouterr().err
    assert "strongest at an end of the depth box, 0.1 to 0.2 m" in printed
    assert "range resolution c/2B is 500 mm, and the depth box 100 mm deep" in printed


@pytest.mark.parametrize(
    ("first_m", "words"), [(0.45, "mm in front of"), (0.16, "mm behind"), (0.3, "")]
)
def test_a_target_a_period_away_is_reported_where_closer_tones_tell(
    first_m, words, tmp_path, capsys
):
    """A point at 0.3 m; tones 1 GHz apart repeat every c/2Δf = 150 mm."""
    given = f"--method 2fsk --set f2_hz=81e9 --set first_depth_m={first_m}"
    assert main([*foreign(tmp_path, np.linspace(82e9, 72e9, 101)), *given.split()]) == 0
    printed = capsys.readouterr().err
    assert words in printed
    assert ("first_depth_m=auto" in printed) == bool(words)
