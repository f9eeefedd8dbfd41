"""One map has one MAE, and one set of checks, whichever way it is made: command, Python, run,
trade-off."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import handbench as hb
from handbench.bench import results
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.bench.tradeoff import run as tradeoff
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.echoes_file import load_capture, save_capture

AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.002}
SET = [f"--set={axis}.{key}={value}" for axis in "xy" for key, value in AXIS.items()]
SWEEP = """
[tradeoff]
sections = ["imaging"]
repeats = 1
[[tradeoff.imaging]]
method = "2fsk"
"""


@pytest.fixture
def bench(small_bench):
    """2-FSK of a capture in a folder, as a benchmark with a sweep of one setting."""
    folder = small_bench.parent
    assert main(["simulate", str(folder / "ball.toml"), "-o", str(folder / "ball")]) == 0
    text = small_bench.read_text().replace('scene = "ball.toml"', 'path = "ball"')
    only_2fsk = "[[method]]".join(text.split("[[method]]")[:2]).replace("precision = true\n", "")
    small_bench.write_text(only_2fsk + SWEEP)
    return small_bench


@pytest.mark.parametrize("protocol", ["paper", "maroon"])
def test_four_ways_give_one_mean_absolute_error(bench, tmp_path, monkeypatch, capsys, protocol):
    def mask(self, depth, erode=False):
        """Half of the map, as a data set may say."""
        return np.isfinite(depth.z_m) & (depth.x_m >= 0)

    monkeypatch.setattr(NativeCapture, "mask", mask)
    capture, map_file = str(bench.parent / "ball"), str(tmp_path / "depth.npz")
    bench.write_text(f'protocol = "{protocol}"\n{bench.read_text()}')
    assert main(["reconstruct", capture, "--method", "2fsk", "-o", map_file, *SET]) == 0
    capsys.readouterr()
    truth = f"{capture}/truth.ply"
    assert (
        main(["evaluate", map_file, "--mesh", truth, "--capture", capture, "--protocol", protocol])
        == 0
    )
    by_command = json.loads(capsys.readouterr().out)["mae_mm"]
    by_python = (
        hb.load(capture).reconstruct("2fsk", x=AXIS, y=AXIS).evaluate(protocol=protocol)["mae_mm"]
    )
    run(*load_benchmark(str(bench)), tmp_path / "run")
    by_run = results.load(tmp_path / "run").row("mae_mm", "2fsk", "truth").value
    swept = tradeoff.run(*load_benchmark(str(bench)), tmp_path / "sweep")
    [setting] = swept.section("imaging")
    assert by_command == by_python == by_run == setting.error > 0


def test_a_mask_without_its_capture_is_refused(bench, tmp_path, capsys):
    capture, map_file = str(bench.parent / "ball"), str(tmp_path / "depth.npz")
    assert main(["reconstruct", capture, "--method", "2fsk", "-o", map_file, *SET]) == 0
    assert (
        main(["evaluate", map_file, "--mesh", f"{capture}/truth.ply", "--protocol", "maroon"]) == 2
    )
    assert "no capture is named; name it" in capsys.readouterr().err


def millimetres(echoes):
    legs = (1e3 * leg.position_m for leg in echoes.aperture.legs)
    return replace(echoes, aperture=AntennaArray(*legs))


def one_tone(echoes):
    return replace(echoes, samples=echoes.samples[:, :1], frequencies_hz=echoes.frequencies_hz[:1])


def test_frequencies_in_gigahertz_are_doubted_before_a_tone_is_missed(bench, tmp_path, capsys):
    capture = bench.parent / "ball"
    echoes = load_capture(capture / "echoes.h5")
    save_capture(
        capture / "echoes.h5", replace(echoes, frequencies_hz=echoes.frequencies_hz * 1e-9)
    )
    assert (
        main(
            [
                "reconstruct",
                str(capture),
                "--method",
                "2fsk",
                "-o",
                str(tmp_path / "depth.npz"),
                *SET,
            ]
        )
        == 2
    )
    written = capsys.readouterr().err
    assert written.index("are these gigahertz?") < written.index("the method asks for")
    with pytest.raises(hb.HandbenchError, match="the method asks for"):
        hb.load(capture).reconstruct("2fsk", x=AXIS, y=AXIS)
    assert "are these gigahertz?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(millimetres, "are its positions millimetres?"), (one_tone, "asks for 82.0000 GHz")],
    ids=["mm", "tone"],
)
def test_four_ways_refuse_the_same_captures(bench, tmp_path, capsys, spoil, words):
    capture = bench.parent / "ball"
    save_capture(capture / "echoes.h5", spoil(load_capture(capture / "echoes.h5")))
    assert (
        main(
            [
                "reconstruct",
                str(capture),
                "--method",
                "2fsk",
                "-o",
                str(tmp_path / "depth.npz"),
                *SET,
            ]
        )
        == 2
    )
    assert words in capsys.readouterr().err
    with pytest.raises(hb.HandbenchError, match=re.escape(words)):
        hb.load(capture).reconstruct("2fsk", x=AXIS, y=AXIS)
    for command in ("run", "tradeoff"):
        assert main([command, str(bench), "-o", str(tmp_path / command)]) == 2
        assert words in capsys.readouterr().err
