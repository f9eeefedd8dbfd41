"""Advice that foreign captures meet: messages name settings, and with these typed the method images
the capture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import methods
from tests.cli.conftest import PIXELS
from tests.radar.simulated_points import exact_capture

SMALL = [*PIXELS, "--set=x.step_m=0.005"]


def foreign(folder, tones_hz, noise=False, times_s=None):
    """The capture folder of a point, or of noise, before a cross of antennas; the start of a
    command that images it."""
    along, zero = np.linspace(-0.05, 0.05, 12), np.zeros(12)
    array = AntennaArray(np.stack([along, zero, zero], 1), np.stack([zero, along, zero], 1))
    capture = exact_capture((0.0, 0.0, 0.3), tones_hz, array=array)
    if noise:
        drawn = np.random.default_rng(0).standard_normal((*capture.samples.shape, 2)) @ [1, 1j]
        capture = replace(capture, samples=drawn.astype(np.complex64))
    capture = replace(capture, times_s=times_s)
    (folder / "foreign").mkdir()
    save_capture(folder / "foreign" / "echoes.h5", capture)
    (folder / "foreign" / "capture.toml").write_text('version = 1\nname = "foreign"\n')
    return ["reconstruct", str(folder / "foreign"), "-o", str(folder / "depth.npz"), *SMALL]


@pytest.mark.parametrize(
    "id", [m.id for m in methods() if requested_tones_hz(m.configure({}, "defaults")) is not None]
)
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
    assert "unambiguous" not in printed
    deep = "--set=z.start_m=0.1 --set=z.stop_m=2.1 --set=z.step_m=0.05 --overwrite"
    assert main([*command, *deep.split()]) == 0
    printed = capsys.readouterr().err
    assert "unambiguous range c/2Δf is 1499 mm, shorter than the box of 2000 mm" in printed


def test_a_target_beyond_the_first_pair_is_reported(tmp_path, capsys):
    """Noise alone: no depth is coherent, and where the pair looks is named."""
    command = foreign(tmp_path, [82e9, 81.8e9, 79.5e9], noise=True)
    assert main([*command[: -len(SMALL)], "--method", "2fsk"]) == 0
    advice = "the two closest tones determine depths only within 375 mm of first_depth_m = 0.45"
    assert f"pixels may be off by a whole period, because {advice}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("first_m", "words"),
    [(0.45, "mm in front of these depths; use"), (0.16, "mm behind these depths; use"), (0.3, "")],
)
def test_a_target_a_period_away_is_reported_where_closer_tones_tell(
    first_m, words, tmp_path, capsys
):
    """A point at 0.3 m; tones 1 GHz apart repeat every c/2Δf = 150 mm."""
    given = f"--method 2fsk --set f2_hz=81e9 --set first_depth_m={first_m}"
    assert main([*foreign(tmp_path, np.linspace(82e9, 72e9, 101)), *given.split()]) == 0
    printed = capsys.readouterr().err
    assert words in printed and ("from 0.30 m" in printed) == bool(words)
    assert ("first_depth_m=auto" in printed) == bool(words)


@pytest.mark.parametrize(
    ("tones_hz", "method", "end"),
    [
        (np.linspace(72e9, 82e9, 26), "broadband", "e.g. count=26"),  # only what differs
        ([77e9, 78e9], "3fsk", ""),  # too few
        ([76e9, 77e9, 77.01e9, 81e9], "broadband", ""),  # which no sweep has
    ],
)
def test_settings_are_named_that_differ_and_would_do(tones_hz, method, end, tmp_path, capsys):
    assert main([*foreign(tmp_path, tones_hz), "--method", method]) == 2
    error = capsys.readouterr().err.strip()
    assert error.endswith(end) and ("e.g." in error) == bool(end)
