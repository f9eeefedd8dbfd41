"""One map has one MAE, and one set of checks, whichever way it is made: command, Python,
run."""

import json
from dataclasses import replace

import numpy as np
import pytest

import handbench as hb
from handbench.bench.benchmarks.benchmark_file import load_benchmark
from handbench.bench.datasets.native import NativeCapture
from handbench.bench.results.result_folder import load
from handbench.bench.run.runner import run
from handbench.cli.main import main
from handbench.radar.data.echoes_file import load_capture, save_capture
from tests.refusals import refuse, refuse_command

AXIS = {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.002}
SET = [f"--set={axis}.{key}={value}" for axis in "xy" for key, value in AXIS.items()]


@pytest.fixture
def bench(recorded, small_bench):
    """2-FSK of a capture in a folder, as a benchmark."""
    text = small_bench.read_text().rpartition("[[method]]")[0].replace("precision = true", "")
    small_bench.write_text(text)
    return small_bench


@pytest.mark.parametrize("protocol", ["paper", "maroon"])
def test_three_ways_give_one_mean_absolute_error(
    bench, undoubted, tmp_path, monkeypatch, capsys, protocol
):
    def mask(self, depth, erode=False):
        """Half of the map, as a data set may say."""
        return np.isfinite(depth.z_m) & (depth.x_m >= 0)

    monkeypatch.setattr(NativeCapture, "mask", mask)
    capture, file = str(bench.parent / "ball"), str(tmp_path / "depth.npz")
    bench.write_text(f'protocol = "{protocol}"\n{bench.read_text()}')
    assert main(["reconstruct", capture, "--method", "2fsk", "-o", file, *SET]) == 0
    evaluate = ["evaluate", file, "--mesh", f"{capture}/truth.ply", "--protocol", protocol]
    capsys.readouterr()
    assert main([*evaluate, "--capture", capture]) == 0
    by_command = json.loads(capsys.readouterr().out)["mae_mm"]
    depth = hb.load(capture).reconstruct("2fsk", x=AXIS, y=AXIS)
    by_python = depth.evaluate(protocol=protocol)["mae_mm"]
    run(*load_benchmark(str(bench)), tmp_path / "run")
    by_run = load(tmp_path / "run").row("mae_mm", "2fsk", "truth").value
    assert by_command == by_python == by_run > 0


def test_three_ways_refuse_the_same_captures(bench, tmp_path, capsys):
    """Tones in gigahertz: what they doubt stands before what they refuse."""
    capture, file, place = bench.parent / "ball", tmp_path / "depth.npz", ", 82.0000 Hz"
    echoes = load_capture(capture / "echoes.h5")
    echoes = replace(echoes, frequencies_hz=1e-9 * echoes.frequencies_hz)
    save_capture(capture / "echoes.h5", echoes)
    assert main(["reconstruct", str(capture), "--method", "2fsk", "-o", str(file), *SET]) == 2
    written = capsys.readouterr().err
    assert written.index("1e9") < written.index(place) and not file.exists()
    refuse(lambda: hb.load(capture).reconstruct("2fsk", x=AXIS, y=AXIS), place)
    refuse_command(["run", str(bench), "-o", str(tmp_path / "run")], place)
