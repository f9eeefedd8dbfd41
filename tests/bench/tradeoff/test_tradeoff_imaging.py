"""A small sweep, from the benchmark file to the folder, its runnable settings and the claim."""

import json
import shutil
from pathlib import Path

import pytest

from handbench.bench.results import Tradeoff
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run as run_benchmark
from handbench.bench.tradeoff.run import run, setting_path
from handbench.cli.main import main
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


FEW = SWEEP.partition("[[")[0] + f'[[tradeoff.imaging]]\nmethod = "3fsk"\nconfig = {{ {AXES} }}\n'


def declare(small_bench: Path, more: str) -> Path:
    """The small benchmark with a sweep."""
    small_bench.write_text(small_bench.read_text() + more)
    return small_bench


@pytest.mark.slow
def test_a_sweep_measures_ranks_claims_and_its_settings_run_anywhere(small_bench, tmp_path):
    """The sensor steps four more tones, of which broadband makes an image."""
    scene = small_bench.parent / "ball.toml"
    tones = "sweep = [{ start_hz = 78.1e9, stop_hz = 81.1e9, count = 4 }]"
    scene.write_text(scene.read_text().replace("sweep = []", tones))
    found = sweep(declare(small_bench, SWEEP), tmp_path / "out")
    facts, lines = found.facts, {s.name: s for s in found.section("imaging")}
    assert len(lines) == 6 and facts.scored_against == "truth" and "left_out" not in facts.facts
    for s in lines.values():
        assert s.error > 0 and s.low is s.high is None  # of one capture
        assert 0 < s.seconds_low <= s.seconds <= s.seconds_high
    assert lines[facts.sections[0].reference].ratio == 1.0
    tones = {json.loads(s.knobs)["method"]: s.acquisition_s for s in lines.values()}
    assert tones == {"2fsk": 0.004, "3fsk": 0.006, "broadband": 0.008}
    half, full = (lines[f"2fsk-tolerance-1e-2{more}"] for more in ("-every_nth_antenna-2", ""))
    # The same pixels, passes and tones, a quarter of the channels; the search for focus has few
    # points, by the aperture.
    assert full.operations == pytest.approx(4 * half.operations, rel=0.01)
    assert facts.claims[0].counted == pytest.approx(4 * 21 * 21 * 11 / (7 * 21 * 21))
    assert len(facts.claims) == 3 and all(c.measured > 0 for c in facts.claims)
    shutil.rmtree(small_bench.parent)
    shutil.rmtree(tmp_path / "out" / "work")
    moved = (tmp_path / "out").rename(tmp_path / "moved")
    bench, base = load_benchmark(str(setting_path(moved, list(lines)[-1])))
    again = run_benchmark(bench, base, tmp_path / "again")
    value = again.row("mae_mm", "broadband", "truth").value
    assert value == pytest.approx(lines[list(lines)[-1]].error)


def test_what_a_setting_cannot_do_is_left_out_and_reported(small_bench, tmp_path, capsys):
    found = sweep(declare(small_bench, FEW + BROADBAND), tmp_path / "out")
    assert {json.loads(s.knobs)["method"] for s in found.section("imaging")} == {"3fsk"}
    [line] = found.facts.facts["left_out"]
    assert line.startswith("ball broadband-") and line in capsys.readouterr().err.splitlines()
    assert found.facts.claims == ()
    alone = small_bench.read_text().partition("[tradeoff]")[0]
    small_bench.write_text(f'{alone}[tradeoff]\nsections = ["imaging"]{BROADBAND}')
    words = "every section failed; the error of the first: every capture failed"
    with pytest.raises(HandbenchError, match=words):
        sweep(small_bench, tmp_path / "none")


def test_the_same_trade_off_is_read_and_another_refused(small_bench, tmp_path, capsys):
    first = sweep(declare(small_bench, FEW), tmp_path / "out")
    assert sweep(small_bench, tmp_path / "out").settings == first.settings
    assert "measures them again" in capsys.readouterr().err
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace("seed = 3", "seed = 4"))
    changed = sweep(small_bench, tmp_path / "out")
    assert changed.facts.inputs != first.facts.inputs and changed.settings != first.settings
    small_bench.write_text(small_bench.read_text().replace("step_s = 0.002", "step_s = 0.001"))
    with pytest.raises(HandbenchError, match="another configuration"):
        sweep(small_bench, tmp_path / "out")
    assert sweep(small_bench, tmp_path / "out", overwrite=True).settings[0].acquisition_s == 0.003


def test_results_of_a_run_are_not_mixed_with(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    with pytest.raises(HandbenchError, match="has the results of `handbench run`"):
        sweep(small_bench, tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "result.json").exists()


def test_the_command_sweeps_then_answers_or_says_what_is_nearest(small_bench, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["tradeoff", str(declare(small_bench, FEW)), "-o", str(out), "--sections"]
    assert main([*command, "imaging", "--max-mae", "1m"]) == 0
    words = f"handbench run {out / 'settings' / '3fsk.toml'} -o RESULTS"
    assert capsys.readouterr().out.rstrip().endswith(words)
    assert main([*command, "imaging", "--max-time", "1us"]) == 2
    assert "the nearest is '3fsk'" in capsys.readouterr().err
    assert main([*command, "imagining"]) == 2
    assert "--sections" in capsys.readouterr().err
