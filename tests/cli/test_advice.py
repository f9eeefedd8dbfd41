"""Advice that foreign captures meet: messages name settings, and with these typed the method images
the capture."""

import re
import shlex

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import methods

C = 299_792_458.0
ALONG = np.linspace(-0.05, 0.05, 12)
POINT_M = np.array([0.0, 0.0, 0.3])
SMALL = shlex.split(
    "--set x.start_m=-0.01 --set x.stop_m=0.01 --set y.start_m=-0.01 --set y.stop_m=0.01 --set "
    "x.step_m=0.005"
)


def foreign(folder, tones_hz):
    """The capture folder of a point before a cross of antennas."""
    array = AntennaArray(
        np.stack([ALONG, 0 * ALONG, 0 * ALONG], 1), np.stack([0 * ALONG, ALONG, 0 * ALONG], 1)
    )
    path_m = np.linalg.norm(POINT_M - array.tx_m, axis=1)[:, None] + np.linalg.norm(
        POINT_M - array.rx_m, axis=1
    )
    samples = np.exp(-2j * np.pi * np.asarray(tones_hz)[:, None, None] * path_m / C)[None].astype(
        np.complex64
    )
    folder.mkdir()
    save_capture(folder / "echoes.h5", RadarCapture(samples, np.asarray(tones_hz), array))
    (folder / "capture.toml").write_text('version = 1\nname = "foreign"\n')
    return folder


def failure(capsys, command) -> str:
    assert main(command) == 2
    return capsys.readouterr().err.strip().splitlines()[-1]


@pytest.mark.parametrize(
    "id", [m.id for m in methods() if requested_tones_hz(m.configure({}, "defaults")) is not None]
)
def test_the_settings_that_are_named_image_the_capture(id, tmp_path, capsys):
    folder = foreign(tmp_path / "foreign", np.linspace(76e9, 81e9, 26)[::-1])
    command = [
        "reconstruct",
        str(folder),
        "--method",
        id,
        "-o",
        str(tmp_path / "depth.npz"),
        *SMALL,
    ]
    error = failure(capsys, command)
    advice = shlex.split(re.search(r"e\.g\. (--set .*)$", error)[1])
    assert main([*command, *advice]) == 0, advice
    with np.load(tmp_path / "depth.npz") as depth:
        assert np.isfinite(depth["z_m"]).any()


def test_only_what_differs_is_named(tmp_path, capsys):
    folder = foreign(tmp_path / "foreign", np.linspace(72e9, 82e9, 26))
    command = [
        "reconstruct",
        str(folder),
        "--method",
        "broadband",
        "-o",
        str(tmp_path / "depth.npz"),
        *SMALL,
    ]
    error = failure(capsys, command)
    assert "fall on the same measured tone of 26" in error and error.endswith("e.g. --set count=26")


@pytest.mark.parametrize(
    ("tones_hz", "method"), [([77e9, 78e9], "3fsk"), ([76e9, 77e9, 77.01e9, 81e9], "broadband")]
)
def test_no_settings_are_named_where_none_would_do(tones_hz, method, tmp_path, capsys):
    """Too few tones, and tones that no sweep has."""
    folder = foreign(tmp_path / "foreign", tones_hz)
    error = failure(
        capsys,
        ["reconstruct", str(folder), "--method", method, "-o", str(tmp_path / "d.npz"), *SMALL],
    )
    assert "set the method's tones to measured ones" in error and "--set" not in error


def test_limits_of_the_box_are_said(tmp_path, capsys):
    folder = foreign(tmp_path / "foreign", np.linspace(76e9, 76.3e9, 4))
    command = [
        "reconstruct",
        str(folder),
        "--method",
        "broadband",
        "-o",
        str(tmp_path / "d.npz"),
        *SMALL,
    ]
    tones = shlex.split("--set start_hz=76e9 --set stop_hz=76.3e9 --set count=4")
    assert main([*command, *tones, *shlex.split("--set z.start_m=0.1 --set z.stop_m=0.2")]) == 0
    said = capsys.readouterr().err
    assert "strongest at an end of the depth box, 0.1 to 0.2 m" in said
    assert "range resolution c/2B is 500 mm, and the depth box 100 mm deep" in said
    assert "unambiguous" not in said
    deep = shlex.split("--set z.start_m=0.1 --set z.stop_m=2.1 --set z.step_m=0.05 --overwrite")
    assert main([*command, *tones, *deep]) == 0
    assert (
        "unambiguous range c/2Δf is 1499 mm, shorter than the box of 2000 mm"
        in capsys.readouterr().err
    )


def test_a_target_beyond_the_first_pair_is_said(tmp_path, capsys):
    """Noise alone: no depth is coherent, and where the pair looks is named."""
    folder = foreign(tmp_path / "foreign", [82e9, 81.8e9, 79.5e9])
    noise = np.random.default_rng(0).standard_normal((1, 3, 12, 12, 2)) @ [1, 1j]
    array = AntennaArray(
        np.stack([ALONG, 0 * ALONG, 0 * ALONG], 1), np.stack([0 * ALONG, ALONG, 0 * ALONG], 1)
    )
    save_capture(
        folder / "echoes.h5",
        RadarCapture(noise.astype(np.complex64), np.array([82e9, 81.8e9, 79.5e9]), array),
    )
    assert (
        main(["reconstruct", str(folder), "--method", "2fsk", "-o", str(tmp_path / "d.npz")]) == 0
    )
    assert (
        "pixels are flagged; the closest tones determine depths within 375 mm of first_depth_m = 0.45"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("tones_hz", "first_m", "told"),
    [
        ([82e9, 81.9e9, 81e9], 0.45, "150 mm before these depths; set first_depth_m=0.30"),
        ([82e9, 81.9e9, 81e9], 0.16, "150 mm behind these depths; set first_depth_m=0.30"),
        ([82e9, 81.9e9, 81e9], 0.3, None),
        ([82e9, 81e9], 0.45, None),  # nothing tells
    ],
)
def test_a_target_a_period_away_is_said_where_closer_tones_tell(
    tones_hz, first_m, told, tmp_path, capsys
):
    """A point at 0.3 m; tones 1 GHz apart repeat every c/2Δf = 150 mm."""
    folder = foreign(tmp_path / "foreign", tones_hz)
    command = [
        "reconstruct",
        str(folder),
        "--method",
        "2fsk",
        "-o",
        str(tmp_path / "d.npz"),
        *SMALL,
    ]
    assert main([*command, "--set", "f2_hz=81e9", "--set", f"first_depth_m={first_m}"]) == 0
    said = capsys.readouterr().err
    assert (
        (told in said and f"within 75 mm of first_depth_m = {first_m}" in said)
        if told
        else "set first" not in said
    )
