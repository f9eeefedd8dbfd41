"""A small sweep, from the benchmark file to the folder, its runnable settings and the claim."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.results import Tradeoff
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run as run_benchmark
from handbench.bench.tradeoff.run import run, setting_path
from handbench.cli.main import main
from handbench.radar.data.arrays import AntennaArray, PlanarScan
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import count_imaging, image_points, image_volume, project_volume
from handbench.support.errors import HandbenchError

AXES = "x = AXIS, y = AXIS".replace("AXIS", "{ start_m = -0.02, stop_m = 0.02, step_m = 0.002 }")
DEPTHS = "z = { start_m = 0.27, stop_m = 0.29, step_m = 0.002 }"
BROADBAND = f"""
[[tradeoff.imaging]]
method = "broadband"
config = {{ {AXES}, {DEPTHS}, start_hz = 78.1e9, stop_hz = 81.1e9, count = 4 }}
"""
SWEEP = f"""
[tradeoff]
repeats = 2
step_s = 0.002
sections = ["imaging"]
[[tradeoff.imaging]]
method = "2fsk"
sweep = {{ tolerance = [1e-2, 1e-4] }}
every_nth_antenna = [1, 2]
[[tradeoff.imaging]]
method = "3fsk"
config = {{ {AXES} }}
{BROADBAND}"""


def sweep(bench_file: Path, folder: Path, **options: bool) -> Tradeoff:
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder, **options)


def declare(small_bench: Path, more: str = SWEEP, broadband: bool = True) -> Path:
    """The small benchmark with a sweep; its sensor steps four more tones, if broadband is to be
    possible."""
    small_bench.write_text(small_bench.read_text() + more)
    if broadband:
        scene = small_bench.parent / "ball.toml"
        tones = "sweep = [{ start_hz = 78.1e9, stop_hz = 81.1e9, count = 4 }]"
        scene.write_text(scene.read_text().replace("sweep = []", tones))
    return small_bench


def test_a_sweep_measures_ranks_and_claims(small_bench, tmp_path):
    found = sweep(declare(small_bench), tmp_path / "out")
    lines = {s.name: s for s in found.section("imaging")}
    assert (
        len(lines) == 6
        and found.facts.scored_against == "truth"
        and "left_out" not in found.facts.facts
    )
    for s in lines.values():
        assert s.error > 0 and s.low is s.high is None  # of one capture
        assert 0 < s.seconds_low <= s.seconds <= s.seconds_high
        assert (
            s.imaging_s + s.extraction_s == pytest.approx(s.seconds)
            and s.extraction_s >= 0
            and s.imaging_s > 0
        )
        assert s.on_front == (not s.dominated_by)
    assert lines[found.facts.sections[0].reference].ratio == 1.0
    tones = {json.loads(s.knobs)["method"]: s.acquisition_s for s in lines.values()}
    assert tones == {"2fsk": 0.004, "3fsk": 0.006, "broadband": 0.008}
    half, full = (lines[f"2fsk-tolerance-1e-2{more}"] for more in ("-every_nth_antenna-2", ""))
    # Pixels, passes and tones alike, a quarter of the channels; the look for focus has few points,
    # by the aperture.
    assert full.operations == pytest.approx(4 * half.operations, rel=0.01)
    claim = found.facts.claims[0]
    assert claim.counted == pytest.approx(4 * 21 * 21 * 11 / (7 * 21 * 21))
    assert len(found.facts.claims) == 3 and all(c.measured > 0 for c in found.facts.claims)


def test_settings_run_and_give_the_same_error_wherever_they_lie(small_bench, tmp_path):
    found = sweep(declare(small_bench), tmp_path / "out")
    shutil.rmtree(small_bench.parent)
    shutil.rmtree(tmp_path / "out" / "work")
    moved = (tmp_path / "out").rename(tmp_path / "moved")
    for name in ("2fsk-tolerance-1e-4", found.section("imaging")[-1].name):
        bench, base = load_benchmark(str(setting_path(moved, name)))
        again = run_benchmark(bench, base, tmp_path / name).row(
            "mae_mm", bench.method[0].id, "truth"
        )
        [measured] = [s for s in found.section("imaging") if s.name == name]
        assert again.value == pytest.approx(measured.error)


def test_what_a_setting_cannot_do_is_left_out_and_said(small_bench, tmp_path, capsys):
    found = sweep(declare(small_bench, broadband=False), tmp_path / "out")
    assert {json.loads(s.knobs)["method"] for s in found.section("imaging")} == {"2fsk", "3fsk"}
    [line] = found.facts.facts["left_out"]
    assert line.startswith("ball broadband-") and line in capsys.readouterr().err.splitlines()
    assert found.facts.claims == ()
    alone = '[tradeoff]\nsections = ["imaging"]' + BROADBAND
    small_bench.write_text(small_bench.read_text().split("[tradeoff]")[0] + alone)
    with pytest.raises(
        HandbenchError, match="every section failed; the first: every capture failed"
    ):
        sweep(small_bench, tmp_path / "none")


def test_the_same_trade_off_is_read_and_another_refused(small_bench, tmp_path, capsys):
    few = (
        SWEEP.split("[[tradeoff.imaging]]")[0]
        + f'[[tradeoff.imaging]]\nmethod = "3fsk"\nconfig = {{ {AXES} }}\n'
    )
    first = sweep(declare(small_bench, few, broadband=False), tmp_path / "out")
    assert sweep(small_bench, tmp_path / "out").settings == first.settings
    assert "--overwrite measures anew" in capsys.readouterr().err
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace("seed = 3", "seed = 4"))
    changed = sweep(small_bench, tmp_path / "out")
    assert changed.facts.inputs != first.facts.inputs and changed.settings != first.settings
    small_bench.write_text(small_bench.read_text().replace("step_s = 0.002", "step_s = 0.001"))
    with pytest.raises(HandbenchError, match="another configuration"):
        sweep(small_bench, tmp_path / "out")
    assert sweep(small_bench, tmp_path / "out", overwrite=True).settings[0].acquisition_s == 0.003


def test_results_of_a_run_are_not_mixed_with(small_bench, tmp_path):
    bench, base = load_benchmark(str(small_bench))
    run_benchmark(bench, base, tmp_path / "out")
    before = (tmp_path / "out" / "result.json").read_bytes()
    with pytest.raises(HandbenchError, match="holds the results of `handbench run`"):
        sweep(small_bench, tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "result.json").read_bytes() == before


def test_a_sweep_with_a_typing_error_is_refused_when_the_benchmark_is_read(small_bench):
    declare(small_bench, SWEEP.replace("tolerance = [1e-2", "tolerence = [1e-2"))
    with pytest.raises(HandbenchError, match="did you mean 'tolerance'"):
        load_benchmark(str(small_bench))


def test_unknown_sections_are_refused(small_bench, tmp_path):
    bench, base = load_benchmark(str(small_bench))
    with pytest.raises(HandbenchError, match="--sections"):
        run(bench, base, tmp_path / "out", sections=("imagining",))


def random_capture(aperture: AntennaArray | PlanarScan) -> RadarCapture:
    random = np.random.default_rng(0)
    samples = (
        random.normal(size=(1, 2, *aperture.channels, 2))
        .view(np.complex128)[..., 0]
        .astype(np.complex64)
    )
    return RadarCapture(samples, np.array([80e9, 82e9]), aperture)


def test_thinned_captures_are_those_of_the_antennas_that_are_left():
    random = np.random.default_rng(1)
    array = random_capture(AntennaArray(random.normal(size=(7, 3)), random.normal(size=(5, 3))))
    third = thin_antennas(array, 3)
    assert third.aperture.channels == (3, 2)
    np.testing.assert_array_equal(third.aperture.tx_m, array.aperture.tx_m[[0, 3, 6]])
    np.testing.assert_array_equal(third.samples, array.samples[:, :, [0, 3, 6]][..., [0, 3]])
    scan = thin_antennas(random_capture(PlanarScan(random.normal(size=(5, 3)))), 2)
    assert scan.aperture.channels == (3,)
    assert thin_antennas(array, 1) is array
    with pytest.raises(HandbenchError, match="every_nth_antenna: is 0"):
        thin_antennas(array, 0)


def test_the_stopwatch_counts_terms_once_and_only_when_asked():
    random = np.random.default_rng(2)
    capture = random_capture(AntennaArray(*(random.normal(scale=0.05, size=(2, 4, 3)))))
    samples, axis = capture.samples[0], np.linspace(-0.01, 0.01, 3)
    grid = VoxelGrid(axis, axis, np.array([0.3, 0.31]))
    known = samples, capture.frequencies_hz, capture.aperture
    image_volume(*known, grid, None)
    with count_imaging() as laps:
        image_points(*known, random.normal(size=(5, 3)) + [0, 0, 3], None)
        assert laps.terms == 5 * samples.size and laps.tones == 2 and laps.imaging_s > 0
        project_volume(*known, grid, None)  # which images a volume
    assert laps.terms == (5 + 18) * samples.size
    image_volume(*known, grid, None)
    assert laps.terms == (5 + 18) * samples.size


def test_the_command_sweeps_then_answers_or_says_what_is_nearest(small_bench, tmp_path, capsys):
    few = (
        f'\n[tradeoff]\nrepeats = 1\n[[tradeoff.imaging]]\nmethod = "3fsk"\nconfig = {{ {AXES} }}\n'
    )
    command = [
        "tradeoff",
        str(declare(small_bench, few, broadband=False)),
        "-o",
        str(tmp_path / "out"),
        "--sections",
        "imaging",
    ]
    assert main([*command, "--max-mae", "1m"]) == 0
    printed = capsys.readouterr().out
    assert printed.rstrip().endswith(
        f"handbench run {tmp_path / 'out' / 'settings' / '3fsk.toml'} -o RESULTS"
    )
    assert main([*command, "--max-time", "1us"]) == 2
    assert "the nearest, '3fsk'" in capsys.readouterr().err
    assert main([*command, "--max-mae", "2"]) == 2
